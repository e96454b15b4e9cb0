"""A live world whose process is a script: a test says when it shows which tick."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import msgspec

from dohyo.evaluation.agent import AgentSpec
from dohyo.service.running.channel import Kind
from dohyo.service.running.process import EpisodeProcess
from dohyo.service.simulating.order import WorldOrder, WorldRules
from dohyo.service.simulating.shown import SHOWN, Decided
from dohyo.service.wire.messages import Format
from dohyo.service.workers.loop_clock import LoopClock
from dohyo.service.worlds.bodies import WorldReply, WorldStep
from dohyo.service.worlds.live.seat import Seat
from dohyo.service.worlds.live.world import LiveWorld
from tests.service.worlds.clients import AHEAD, scenario

CONTROL = "lane_command"


class ScriptedProcess(EpisodeProcess):
    """Keeps the frames that it is sent, and shows what the test wants."""

    def __init__(self) -> None:
        super().__init__(Path())
        self.sent: list[tuple[Kind, bytes]] = []

    def send(self, kind: Kind, payload: bytes = b"") -> None:
        self.sent.append((kind, payload))

    def show(self, tick: int, revision: int, x_m: float) -> None:
        shown = {"driving": ["front"], "poses": {"front": (x_m, 0.0, 0.0, 0.0, 0.0)}, "observations": {}}
        self.seen(Kind.SEEN, SHOWN.pack(tick, tick / 10, revision) + msgspec.msgpack.encode(shown))


class StandingClock(LoopClock):
    """Time that passes when a test says so, s."""

    def __init__(self) -> None:
        super().__init__()
        self.now_s = 0.0

    def monotonic(self) -> float:
        return self.now_s


class ScriptedWorld(LiveWorld):
    """A world with the ego "front", at x = 0 m in each first tick.

    Attributes:
        time: By which decisions are due.
    """

    def __init__(self, **rules: Any) -> None:
        self.process, self.time = ScriptedProcess(), StandingClock()
        given = {"deadline_s": 60.0, "late": "repeat", "pace": "lockstep", "speed": 1.0} | rules
        order = WorldOrder(name="world", scenario=scenario(1))
        super().__init__("world", "lab", order, self.process, WorldRules.model_validate(given), self.time)

    def show(self, tick: int, x_m: float = 0.0) -> None:
        """The process shows a tick, with the present drivers."""
        self.process.show(tick, self.simulation.revision, x_m)

    async def seat(self, seat: Seat, tick: int = 0) -> Seat:
        """Lets a worker join at a tick."""
        joining = asyncio.create_task(self.join(seat))
        await asyncio.sleep(0)
        self.show(tick)
        await joining
        return seat

    def kinds(self) -> list[Kind]:
        """Kinds of the frames that the process was sent."""
        return [kind for kind, _ in self.process.sent]

    @property
    def decided(self) -> list[Decided]:
        """What the process was sent for each tick."""
        sent = [payload for kind, payload in self.process.sent if kind is Kind.ACTIONS]
        return [msgspec.msgpack.decode(payload, type=Decided) for payload in sent]


def place(name: str, *egos: str, control: str = CONTROL, owner: str = "lab") -> Seat:
    """A place of a simulator that is coupled."""
    spec = AgentSpec(name=name, track="sensors", sensors=("speedometer",), control=control)
    return Seat(spec, egos, owner, "", coupled=True)


async def step(world: LiveWorld, seat: Seat, tick: int, action: Any = AHEAD, **more: Any) -> WorldReply:
    """A step of a place, in JSON."""
    body = {"tick": tick, "actions": dict.fromkeys(seat.egos, action)} | more
    return await world.steps.take(seat, msgspec.json.decode(msgspec.json.encode(body), type=WorldStep), Format.JSON)
