"""WorkerSession: a policy worker's side of the wire, over one kept connection, in msgpack.

A worker is a loop, as in examples/planner.py::

    with WorkerSession("http://127.0.0.1:8000", token, "my-agent") as session:
        while True:
            drive = session.next_drive()
            while not drive.done:
                session.step(drive, {ego: decide(seen) for ego, seen in drive.observations.items()})

A step may be sent again after any failure of the network; the server answers the same tick with the same reply.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Literal, Self

import numpy as np

from dohyo.service.client.connection import (
    BadActionError,
    Connection,
    ForeignAnswerError,
    LeaseLostError,
    Pauses,
    UnknownWorkerError,
    UnreachableError,
    WireError,
    passes,
)
from dohyo.service.wire.messages import arrays, pack
from dohyo.sumo_networks.scenario import Mission
from dohyo.sumo_networks.sensors import Observation

__all__ = [
    "BadActionError",
    "Drive",
    "ForeignAnswerError",
    "LeaseLostError",
    "UnknownWorkerError",
    "UnreachableError",
    "WireError",
    "WorkerSession",
]

ACQUIRE_S = 20.0
LONGEST_TEXT = 500
FULL = 409  # the service has not noticed yet that this worker holds no episode any more
UNTOLD = {"start": {"lane": "untold"}, "goal": {"lane": "untold"}}

logger = logging.getLogger("dohyo.worker")


@dataclass(slots=True)
class Drive:
    """A leased episode from the worker's point of view.

    Attributes:
        lease: Identifier.
        attempt: Number of the attempt, from 1.
        deadline_s: Time for one decision.
        first_deadline_s: Time for the first decision.
        slow_policy: Whether the simulation waits.
        spec: name, version, track, sensors, control and settings, as submitted.
        missions: Missions by ego; below the track `privileged` their places are "untold".
        seed: Seed for `Agent.reset`; unrelated to the scenario's.
        tick: Tick that awaits a decision.
        observations: Observations at that tick, by ego and sensor.
        time_s: Simulated time of the tick.
        done: Whether the episode is over.
        missed: Number of ticks without a decision.
        directive: "run", or "drain": the service ends soon, or "abort": the evaluation was ended.
    """

    lease: str
    attempt: int
    deadline_s: float
    first_deadline_s: float
    slow_policy: Literal["wait", "realtime"]
    spec: dict[str, Any]
    missions: dict[str, Mission]
    seed: int
    tick: int
    observations: dict[str, Observation]
    time_s: float = 0.0
    done: bool = False
    missed: int = 0
    directive: str = "run"

    @classmethod
    def given(cls, answer: Mapping[str, Any]) -> Self:
        """Drive from the answer to an acquire request."""
        return cls(
            lease=answer["lease"],
            attempt=answer["attempt"],
            deadline_s=answer["deadline_ms"] / 1000,
            first_deadline_s=answer["first_deadline_ms"] / 1000,
            slow_policy=answer["slow_policy"],
            spec=answer["spec"],
            missions={one["name"]: Mission.model_validate(UNTOLD | one) for one in answer["missions"]},
            seed=answer["seed"],
            tick=answer["tick"],
            observations=arrays(answer["observations"]),
        )

    def take(self, answer: Mapping[str, Any]) -> None:
        """Updates the drive with the answer to a step."""
        self.tick, self.time_s = answer["tick"], answer["time_s"]
        self.observations = arrays(answer["observations"])
        self.done, self.missed, self.directive = answer["done"], answer["missed"], answer["directive"]


class WorkerSession:
    """A registered worker; not thread-safe, except `heartbeat`.

    Attributes:
        lease_ttl_s: Silence after which it loses its lease, s.
        heard: Monotonic time of the last request that the service received.
    """

    def __init__(
        self,
        url: str,
        token: str,
        agent: str,
        *,
        version: int | None = None,
        capacity: int = 1,
        patience_s: float = 120.0,
    ) -> None:
        """Registers at the first `acquire`.

        Args:
            url: Address of the service.
            token: Token with the role worker or submitter.
            agent: Name of the agent.
            version: Version of the agent; None: any.
            capacity: Most episodes at once.
            patience_s: Time during which a step or a release is repeated while the service cannot answer.
        """
        self._connection, self._pulse = Connection(url), Connection(url, timeout_s=10.0)
        self._api_token, self._agent, self._version, self._capacity = token, agent, version, capacity
        self._patience_s = patience_s
        self._worker = self._token = ""
        self._pulse_lock = threading.Lock()
        self.lease_ttl_s = 30.0
        self.heard = time.monotonic()

    def register(self) -> None:
        """Registers the worker, again if it was registered before.

        Raises:
            WireError: The token does not permit this agent.
            UnreachableError: No service answers.
        """
        order = {"agent": self._agent, "capacity": self._capacity, "version": self._version}
        try:
            answer = self._connection.post("/v1/workers", order, self._api_token)
        except UnknownWorkerError as error:
            raise WireError(error.status, error.detail) from error  # the token itself is refused
        self._worker, self._token, self.lease_ttl_s = answer["worker"], answer["token"], answer["lease_ttl_s"]

    def acquire(self, wait_s: float = ACQUIRE_S) -> Drive | None:
        """Waits for an episode; None after the time-out.

        Raises:
            UnknownWorkerError: The service no longer knows this worker; the next call registers it again.
            WireError: The service refuses.
            UnreachableError: No service answers.
        """
        if not self._worker:
            self.register()
        try:
            answer = self._connection.post(f"/v1/workers/{self._worker}/acquire?wait={wait_s:g}", {}, self._token)
        except UnknownWorkerError:
            self._worker = ""
            raise
        self.heard = time.monotonic()
        return Drive.given(answer) if answer is not None else None

    def next_drive(self) -> Drive:
        """Waits for an episode for as long as it takes, and registers again after a restart of the service.

        Raises:
            WireError: The service refuses this worker for good.
        """
        pauses = Pauses()
        while True:
            try:
                drive = self.acquire()
            except (UnreachableError, WireError) as error:
                full = isinstance(error, WireError) and error.status == FULL
                if not (passes(error) or full or isinstance(error, UnknownWorkerError)):
                    raise
                logger.warning("%s", error)
                time.sleep(pauses.next(error))
                continue
            if drive is not None:
                return drive
            pauses.reset()

    def step(self, drive: Drive, actions: Mapping[str, Any]) -> None:
        """Sends the decisions of all egos and updates the drive with the answer.

        Raises:
            BadActionError: An action is invalid; others may be sent.
            LeaseLostError: The lease is lost.
            WireError: The service refuses, or cannot answer within `patience_s`.
            UnreachableError: No service answers within `patience_s`.
        """
        packed = {ego: pack(np.asarray(action)) for ego, action in actions.items()}
        answer = self._insist(f"/v1/leases/{drive.lease}/step", {"tick": drive.tick, "actions": packed})
        self.heard = time.monotonic()
        drive.take(answer)

    def heartbeat(self, drive: Drive) -> None:
        """Renews the lease during a long decision; callable from any thread.

        Raises:
            LeaseLostError: The lease is lost.
            UnreachableError: No service answers.
        """
        with self._pulse_lock:
            self._pulse.post(f"/v1/leases/{drive.lease}/heartbeat", {}, self._token)
        self.heard = time.monotonic()

    def release(
        self, drive: Drive, reason: str = "", error: str | None = None, *, patience_s: float | None = None
    ) -> None:
        """Releases an episode: with an `error` as the agent's fault, otherwise it is driven again.

        Args:
            drive: The leased episode.
            reason: Why, for the service's log.
            error: What the agent did wrong.
            patience_s: Time during which it is repeated; None: that of the session.

        Raises:
            LeaseLostError: The lease was lost before.
            WireError: The service refuses, or cannot answer in that time.
            UnreachableError: No service answers in that time.
        """
        document = {"reason": reason[:LONGEST_TEXT], "error": error[:LONGEST_TEXT] if error is not None else None}
        self._insist(f"/v1/leases/{drive.lease}/release", document, patience_s, ends_lease=True)

    def close(self) -> None:
        """Closes the connections; a lease that is still held expires."""
        self._connection.close()
        self._pulse.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        self.close()

    def _insist(self, path: str, document: Any, patience_s: float | None = None, *, ends_lease: bool = False) -> Any:
        """Sends an idempotent request until it is answered."""
        ends = time.monotonic() + (self._patience_s if patience_s is None else patience_s)
        pauses, repeated = Pauses(), False
        while True:
            try:
                return self._connection.post(path, document, self._token)
            except UnknownWorkerError as error:
                self._worker = ""  # the service was restarted, and the episode with it
                raise LeaseLostError(410, error.detail) from error
            except (UnreachableError, WireError) as error:
                if repeated and ends_lease and isinstance(error, LeaseLostError):
                    return None  # the answer to the first of these requests was lost, not the request
                pause_s = pauses.next(error)
                if not passes(error) or time.monotonic() + pause_s > ends:
                    raise
                repeated = True
                time.sleep(pause_s)
