"""Seat: a worker's place in a world, with its egos."""

from __future__ import annotations

import asyncio
import secrets
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dohyo.evaluation.agent import AgentSpec
from dohyo.service.errors import GoneError
from dohyo.service.wire.actions import checked_action
from dohyo.service.wire.answering import answer_all
from dohyo.service.wire.messages import pack, unpack
from dohyo.service.wire.requests import StaleRunError
from dohyo.service.worlds.bodies import WorldReply
from dohyo.sumo_networks.ego.control import Control, make_control
from dohyo.sumo_networks.ego.dynamics import VehicleParameters
from dohyo.sumo_networks.ego.pose import WORLD_CONTROLS, ImplausiblePoseError, Pose, PoseControl, check_plausible
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.units import TICK_S

Actions = Mapping[str, Mapping[str, Any]]
"""Action of each ego, packed for the process."""


@dataclass(frozen=True, slots=True)
class Decision:
    """What a worker has decided for a tick, checked.

    Attributes:
        actions: Action of each ego.
        clipped: Actions with a value out of range.
        poses: Pose of each ego whose vehicle is simulated elsewhere.
    """

    actions: Actions
    clipped: int
    poses: Mapping[str, Pose]


@dataclass(eq=False, slots=True)
class Seat:
    """A worker's place in a world.

    Attributes:
        spec: Name, sensors and control of the driver.
        egos: Egos that it drives.
        owner: Owner of the worker.
        token_id: API token with which the worker joined.
        coupled: Whether it is a simulator that sees all actors, and may have no ego.
        id: Identifier in paths; a worker that joins again gets another one.
        token: Secret of its messages.
        tick: Tick last shown to the worker.
        resets: How often the world had begun anew at that tick.
        decision: Its decision for that tick; None: it decides now.
        last: Its last decision.
        repeated: Whether the decision before this one was a repetition.
        answered: Tick that `reply` answers; -1: none.
        reply: Last reply, for repeated requests.
        due: Time of the loop by which its decision is due.
        missed: Ticks that repeated its last decision.
        clipped: Actions with a value out of range.
        waiting: Requests that wait for the reply to `tick`.
        ended: Why it has no place any more; "" while it has.
    """

    spec: AgentSpec
    egos: tuple[str, ...]
    owner: str
    token_id: str
    coupled: bool = False
    id: str = field(default_factory=lambda: f"s-{secrets.token_hex(12)}")
    token: str = field(default_factory=lambda: secrets.token_urlsafe(32))
    tick: int = 0
    resets: int = 0
    decision: Actions | None = None
    last: Actions | None = None
    repeated: bool = False
    answered: int = -1
    reply: WorldReply | None = None
    due: float = 0.0
    missed: int = 0
    clipped: int = 0
    waiting: list[asyncio.Future[WorldReply]] = field(default_factory=list)
    ended: str = ""
    _control: Control = field(init=False)
    _posed: dict[str, tuple[Pose, int]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._control = make_control(self.spec.control, VehicleParameters(), TICK_S, WORLD_CONTROLS)

    def is_like(self, other: Seat) -> bool:
        """Whether a place is for the same egos, sensors and control."""
        return (self.spec, self.egos, self.coupled) == (other.spec, other.egos, other.coupled)

    def begin(self, tick: int, resets: int, due: float) -> None:
        """The worker learns of a tick, after so many resets, and decides until `due`."""
        self.tick, self.resets, self.due, self.answered, self.reply = tick, resets, due, -1, None

    def take_over(self, before: Seat) -> None:
        """Takes over what the worker had decided before it joined again."""
        self.decision, self.last = before.decision, before.last
        self.missed, self.clipped, self._posed = before.missed, before.clipped, before._posed

    def restart(self) -> None:
        """The world begins anew: nothing is decided."""
        self.decision, self.last, self.repeated = None, None, False
        self._posed.clear()

    def check(self, actions: object, deciding: tuple[str, ...], poses: Mapping[str, Pose]) -> Decision:
        """Checks the decision for this tick.

        Args:
            actions: Actions by ego, as they were sent.
            deciding: Egos of this seat that still drive.
            poses: Their poses before the tick.

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
        given_poses: dict[str, Pose] = {}
        if isinstance(self._control, PoseControl):
            given_poses = {ego: self._control.pose(action) for ego, (action, _) in checked.items()}
            self._check_poses(given_poses, poses)
        packed = {ego: pack(np.asarray(action)) for ego, (action, _) in checked.items()}
        return Decision(packed, sum(clipped for _, clipped in checked.values()), given_poses)

    def decide(self, decision: Decision) -> None:
        """Takes a decision for this tick that was checked."""
        self.decision = self.last = decision.actions
        self.repeated, self.clipped = False, self.clipped + decision.clipped
        self._posed |= {ego: (pose, self.tick) for ego, pose in decision.poses.items()}

    def _check_poses(self, given: Mapping[str, Pose], poses: Mapping[str, Pose]) -> None:
        """Compares each pose with the last one that was sent, or with the present one where none was."""
        for ego, pose in given.items():
            before, tick = self._posed.get(ego, (poses[ego], self.tick - 1))
            try:
                check_plausible(before, pose, (self.tick - tick) * TICK_S)
            except ImplausiblePoseError as error:
                raise InvalidInputError(f"pose of '{ego}': {error}") from None

    def repeat(self) -> None:
        """Takes the last decision once more; there is one."""
        assert self.last is not None
        again = {ego: self._control.repeated(unpack(action)) for ego, action in self.last.items()}
        self.decision = self.last = {ego: pack(np.asarray(action)) for ego, action in again.items()}
        self.repeated, self.missed = True, self.missed + 1

    def answer(self, answer: WorldReply | Exception) -> None:
        """Answers all requests that wait."""
        answer_all(self.waiting, answer)

    def show(self, reply: WorldReply) -> None:
        """Answers the decision for the last tick with the next one."""
        self.answered = self.tick if reply.tick > self.tick else -1  # a new beginning answers no decision
        self.reply, self.tick, self.resets, self.decision = reply, reply.tick, reply.resets, None
        self.answer(reply)

    def end(self, why: str) -> None:
        """Takes the place away."""
        self.ended = self.ended or why
        self.answer(GoneError(f"seat lost: {self.ended}"))

    def refuse_stale_run(self, resets: int | None) -> None:
        """Refuses a decision for a run of the world that is not the one last shown; None: it names none.

        Raises:
            GoneError: The worker has no place any more.
            StaleRunError: The world has begun anew since.
        """
        if resets is not None and resets != self.resets:
            self.refuse_ended()
            raise StaleRunError(self.resets, self.tick, resets)

    def refuse_ended(self) -> None:
        """Raises GoneError if it has no place any more."""
        if self.ended:
            raise GoneError(f"seat lost: {self.ended}")
