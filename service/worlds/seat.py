"""Seat: a worker's place in a world, with its egos."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import msgspec
import numpy as np

from dohyo.evaluation.agent import AgentSpec
from dohyo.service.errors import GoneError
from dohyo.service.wire.actions import checked_action
from dohyo.service.wire.answering import answer_all
from dohyo.service.wire.bodies import Reply
from dohyo.service.wire.messages import pack
from dohyo.sumo_networks.ego.control import Control, make_control
from dohyo.sumo_networks.ego.dynamics import VehicleParameters
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.units import TICK_S

Actions = Mapping[str, Mapping[str, Any]]
"""Action of each ego, packed for the process."""


@dataclass(eq=False, slots=True)
class Seat:
    """A worker's place in a world.

    Attributes:
        id: Identifier in paths; a worker that joins again gets another one.
        token: Secret of its messages.
        spec: Name, sensors and control of the driver.
        egos: Egos that it drives.
        token_id: API token with which the worker joined.
        tick: Tick last shown to the worker.
        decision: Its decision for that tick; None: it decides now.
        last: Its last decision.
        answered: Tick that `reply` answers; -1: none.
        reply: Last reply, for repeated requests.
        due: Monotonic time by which its decision is due.
        missed: Ticks that repeated its last decision.
        clipped: Actions with a value out of range.
        waiting: Requests that wait for the reply to `tick`.
        ended: Why it has no place any more; "" while it has.
    """

    id: str
    token: str
    spec: AgentSpec
    egos: tuple[str, ...]
    token_id: str
    tick: int = 0
    decision: Actions | None = None
    last: Actions | None = None
    answered: int = -1
    reply: Reply | None = None
    due: float = 0.0
    missed: int = 0
    clipped: int = 0
    waiting: list[asyncio.Future[Reply]] = field(default_factory=list)
    ended: str = ""
    _control: Control = field(init=False)

    def __post_init__(self) -> None:
        self._control = make_control(self.spec.control, VehicleParameters(), TICK_S)

    def begin(self, tick: int, due: float) -> None:
        """The worker learns of a tick, and decides until `due`."""
        self.tick, self.due, self.answered, self.reply = tick, due, -1, None

    def take_over(self, before: Seat) -> None:
        """Takes over what the worker had decided before it joined again."""
        self.decision, self.last = before.decision, before.last
        self.missed, self.clipped = before.missed, before.clipped

    def decide(self, actions: object, deciding: tuple[str, ...]) -> None:
        """Takes the decision for this tick.

        Args:
            actions: Actions by ego, as they were sent.
            deciding: Egos of this seat that still drive.

        Raises:
            InvalidInputError: An action is missing or invalid, or is for an ego of somebody else.
        """
        given = actions if isinstance(actions, dict) else {}
        if missing := [ego for ego in deciding if ego not in given]:
            raise InvalidInputError(f"expected an action for each of {list(deciding)}, got none for {missing}")
        if unknown := sorted(set(map(str, given)) - set(self.egos)):
            raise InvalidInputError(f"expected actions of {list(self.egos)} only, got {unknown[:10]} too")
        shape = tuple(self._control.space.shape)
        checked = {ego: checked_action(ego, given[ego], shape, self._control.checked) for ego in deciding}
        self.clipped += sum(clipped for _, clipped in checked.values())
        self.decision = self.last = {ego: pack(np.asarray(action)) for ego, (action, _) in checked.items()}

    def answer(self, answer: Reply | Exception) -> None:
        """Answers all requests that wait."""
        answer_all(self.waiting, answer)

    def show(self, tick: int, time_s: float, seen: dict[str, msgspec.Raw], *, done: bool) -> None:
        """Answers the decision for the last tick with the next one."""
        observations = msgspec.Raw(msgspec.msgpack.encode(seen))
        reply = Reply(tick, time_s, observations, done=done, missed=self.missed, clipped=self.clipped, directive="run")
        self.answered, self.reply, self.tick, self.decision = self.tick, reply, tick, None
        self.answer(reply)

    def end(self, why: str) -> None:
        """Takes the place away."""
        self.ended = self.ended or why
        self.answer(GoneError(f"seat lost: {self.ended}"))

    def refuse_ended(self) -> None:
        """Raises GoneError if it has no place any more."""
        if self.ended:
            raise GoneError(f"seat lost: {self.ended}")
