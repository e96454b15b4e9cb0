"""A world in its process: egos whose drivers come and go, between the simulation and the server's lockstep."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping

import msgspec
import numpy as np

from dohyo.agents.registry import resolve
from dohyo.evaluation.agent import Agent, AgentSpec, Mission, Observation, agent_info, make_agent
from dohyo.evaluation.episode.runner import agents_env, drive_episode
from dohyo.evaluation.records.record import AgentInfo
from dohyo.evaluation.records.store import write_record
from dohyo.service.running.channel import Channel, Kind
from dohyo.service.simulating.coupling import shown_actors
from dohyo.service.simulating.order import Drivers, Reset, Undriven, WorldOrder
from dohyo.service.simulating.shown import SHOWN, Decided
from dohyo.service.spectating.scene import SceneFeed
from dohyo.service.wire.messages import pack, unpack
from dohyo.sumo_networks.envs.driving_env import DrivingEnv
from dohyo.sumo_networks.envs.reward_meter import RewardMeter
from dohyo.sumo_networks.errors import AgentTimeoutError
from dohyo.sumo_networks.units import TICK_S

_TRACKS = ("sensors", "map", "privileged")


class Standing(Agent):
    """Brakes to a stop and stays in its lane."""

    spec = AgentSpec(name="standing", track="sensors", sensors=("speedometer",), control="lane_command")

    def reset(self, mission: Mission, seed: int) -> None:
        """Does nothing: it needs to know nothing."""

    def act(self, observation: Observation) -> np.ndarray:
        """A target speed of 0 and no change of lane."""
        return np.zeros(2)

    def close(self) -> None:
        """Does nothing: it holds no resources."""


class Absent(Standing):
    """Leaves the road: an ego that nobody drives has ended its drive."""

    spec = Standing.spec.model_copy(update={"name": "absent"})

    def act(self, observation: Observation) -> np.ndarray:
        """Raises AgentTimeoutError."""
        raise AgentTimeoutError("nobody drives this ego, and the world takes such egos out")


def substitute_for(undriven: Undriven) -> tuple[Agent, AgentInfo]:
    """Agent of an ego without a driver."""
    if undriven == "autopilot":
        entry = resolve("autopilot")
        agent = make_agent(entry)
        return agent, agent_info(agent, entry, kind="builtin")
    standing = Standing() if undriven == "stand" else Absent()
    return standing, agent_info(standing, f"{Standing.__module__}:{type(standing).__name__}", kind="builtin")


class WorldEgo(Agent):
    """One ego: its driver decides, or its substitute while nobody drives it.

    Attributes:
        driver: Specification of the driver; None: nobody drives it.
        seen: What the driver or the substitute observes in this tick.
        action: The driver's decision for this tick.
        drove: Everybody who drove it, in turn.
    """

    def __init__(self, substitute: Agent, info: AgentInfo, world: WorldProcess) -> None:
        self.spec, self._substitute, self._info, self._world = substitute.spec, substitute, info, world
        self.driver: AgentSpec | None = None
        self.seen: Observation = {}
        self.action = np.zeros(0)
        self.drove: list[AgentInfo] = []
        self._began: tuple[Mission, int] | None = None

    def warm_up(self) -> None:
        """Warms the substitute up."""
        self._substitute.warm_up()

    def reset(self, mission: Mission, seed: int) -> None:
        """Prepares the substitute."""
        self._began = mission, seed
        self._substitute.reset(mission, seed)

    def hand_over(self, driver: AgentSpec | None) -> AgentSpec:
        """Changes the driver; returns the specification that holds from now on."""
        if driver is None and self._began is not None:
            self._substitute.reset(*self._began)
        self.driver = driver
        self.spec = driver or self._substitute.spec
        return self.spec

    def note(self) -> None:
        """Notes who drives this tick."""
        now = self._info if self.driver is None else _info_of(self.driver)
        if not self.drove or self.drove[-1] != now:
            self.drove.append(now)

    def act(self, observation: Observation) -> np.ndarray:
        """The decision of the driver, who has observed this tick already, or of the substitute."""
        if self._world.ended:
            raise AgentTimeoutError(self._world.ended)
        return self.action if self.driver is not None else self._substitute.act(self.seen)

    def close(self) -> None:
        """Frees the resources of the substitute."""
        self._substitute.close()

    @property
    def info(self) -> AgentInfo:
        """Description for the record; several drivers are named in turn, with the most that any of them could do."""
        last = self.drove[-1] if self.drove else self._info
        names = " + ".join(one.name for one in self.drove)
        if len(self.drove) < 2:
            return last
        could = {
            "track": max((one.track for one in self.drove), key=_TRACKS.index),
            "sensors": tuple(dict.fromkeys(sensor for one in self.drove for sensor in one.sensors)),
            "control": "pose" if any(one.control == "pose" for one in self.drove) else last.control,
        }
        return last.model_copy(update={"name": names, "kind": "remote", **could})


def _info_of(spec: AgentSpec) -> AgentInfo:
    return AgentInfo(kind="remote", entry=f"remote:{spec.name}", **spec.model_dump())


class WorldProcess:
    """The lockstep's end in the process: shows each tick, and takes new drivers and decisions.

    Attributes:
        egos: Every ego by its name.
        ended: Why the server has ended the world; "" while it goes on.
    """

    def __init__(self, order: WorldOrder, channel: Channel, drivers: Drivers, scenes: SceneFeed) -> None:
        self.ended = ""
        self._channel, self._revision = channel, 0
        self.egos = {m.name: WorldEgo(*substitute_for(order.undriven), self) for m in order.scenario.missions}
        self.env: DrivingEnv = agents_env(order.scenario, self.egos)
        self._drivers, self._scenes = drivers, scenes
        scenes.begin(self.env)
        self._meter = RewardMeter(order.reward, len(self.egos)) if order.reward else None

    def show(self, tick: int, observations: dict[str, Observation]) -> None:
        """Sends a tick to the server and waits for the decisions."""
        for name, seen in observations.items():
            self.egos[name].seen = seen
        if self._revision != self._drivers.revision:  # the first tick of a world that was reset
            self._change(self._drivers, list(observations))
        self._scenes.tick()
        while not self.ended:
            self._send(tick, list(observations))
            if self._take(*self._receive(), list(observations)):
                break
        for name in observations:
            self.egos[name].note()

    def wait(self, tick: int) -> None:
        """Shows that all egos have ended their drives, and waits until the world is reset or ended."""
        while not self.ended:
            self._send(tick, [])
            self._take(*self._receive(), [])

    def _send(self, tick: int, driving: list[str]) -> None:
        head = SHOWN.pack(tick, round(tick * TICK_S, 3), self._revision)
        seen = {name: self.egos[name].seen for name in driving if self.egos[name].driver is not None}
        outcomes = self._meter.read(self.env.world) if self._meter else {}
        seen |= {name: self.env.observe(name) for name in outcomes.keys() - driving if self.egos[name].driver}
        packed = {name: {sensor: pack(array) for sensor, array in one.items()} for name, one in seen.items()}
        shown = {
            "driving": driving,
            "poses": self._poses(driving),
            "observations": packed,
            "actors": shown_actors(self.env) if self._drivers.coupled and driving else None,
            "outcomes": outcomes,
        }
        self._channel.send(Kind.SEEN, head + msgspec.msgpack.encode(shown))

    def _poses(self, driving: list[str]) -> dict[str, tuple[float, ...]]:
        egos = self.env.world.egos
        along = egos.speed * np.cos(egos.heading), egos.speed * np.sin(egos.heading)
        rows = np.column_stack([egos.position, egos.heading, *along]).tolist()
        return {name: tuple(row) for name, row in zip(egos.names, rows, strict=True) if name in driving}

    def _receive(self) -> tuple[Kind, bytes]:
        """The next frame of the lockstep; spectators get their scenes meanwhile."""
        while True:
            frame = self._channel.receive(self._scenes.due_in_s())
            if frame is None:
                self._scenes.send()
            elif frame[0] is Kind.WATCH:
                self._scenes.watch(frame[1] == b"\1")
            else:
                return frame

    def _take(self, kind: Kind, payload: bytes, driving: list[str]) -> bool:
        """Whether the tick can go on after a frame."""
        if kind is Kind.FAULT:
            self.ended = str(json.loads(payload)[1])
        elif kind is Kind.DRIVERS:
            self._change(Drivers.model_validate_json(payload), driving)
        elif kind is Kind.RESET:
            raise WorldReset(Reset.model_validate_json(payload), self._drivers)
        elif kind is Kind.ACTIONS:
            decided = msgspec.msgpack.decode(payload, type=Decided)
            for name, action in decided.actions.items():
                self.egos[name].action = unpack(action)
            self.env.external.change((row.external() for row in decided.actors.put), decided.actors.remove)
            return True
        return False

    def _change(self, drivers: Drivers, driving: list[str]) -> None:
        self._revision = drivers.revision
        self._drivers = drivers.model_copy(update={"specs": self._drivers.specs | drivers.specs})
        for name, driver in drivers.specs.items():
            spec = self.egos[name].hand_over(driver)
            if name in driving:
                self.egos[name].seen = self.env.outfit(name, spec.sensors, spec.control)


class WorldReset(Exception):  # noqa: N818 - it is no error
    """The world begins anew.

    Attributes:
        reset: Order of the server.
        drivers: Drivers of the egos.
    """

    def __init__(self, reset: Reset, drivers: Drivers) -> None:
        super().__init__("the world is reset")
        self.reset, self.drivers = reset, drivers


class LateInfos(Mapping[str, AgentInfo]):
    """Descriptions of the egos' agents, which are known when the record is written."""

    def __init__(self, egos: Mapping[str, WorldEgo]) -> None:
        self._egos = egos

    def __getitem__(self, name: str) -> AgentInfo:
        return self._egos[name].info

    def __iter__(self) -> Iterator[str]:
        return iter(self._egos)

    def __len__(self) -> int:
        return len(self._egos)


def drive_world(order: WorldOrder, channel: Channel) -> bytes:
    """Simulates a world to the end of all its egos and writes its record if one is wanted.

    Returns:
        The last tick, as `SHOWN`.

    Raises:
        InvalidInputError: The scenario cannot be driven.
    """
    drivers, scenes = Drivers(revision=0, specs={}), SceneFeed(channel)
    while True:
        try:
            return _drive_once(order, channel, drivers, scenes)
        except WorldReset as again:
            _forget_record(order)
            scenario = order.scenario.model_copy(update={"seed": again.reset.seed})
            order = order.model_copy(update={"scenario": scenario})
            drivers = again.drivers.model_copy(update={"revision": again.reset.revision})


def _forget_record(order: WorldOrder) -> None:
    """Removes the record of the run before: a world has that of its last run."""
    if order.directory is not None:
        for suffix in (".json", ".parquet"):
            (order.directory / f"{order.name}{suffix}").unlink(missing_ok=True)


def _drive_once(order: WorldOrder, channel: Channel, drivers: Drivers, scenes: SceneFeed) -> bytes:
    world = WorldProcess(order, channel, drivers, scenes)
    record, trajectory = drive_episode(
        order.scenario, world.egos, infos=LateInfos(world.egos), show=world.show, env=world.env
    )
    if order.directory is not None:
        write_record(order.directory, order.name, record, trajectory)
    if order.stays:
        world.wait(record.ticks)
    return SHOWN.pack(record.ticks, round(record.ticks * TICK_S, 3), 0)
