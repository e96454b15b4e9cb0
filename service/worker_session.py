"""WorkerSession: a policy worker's side of the wire, over one kept connection, in msgpack. A worker is a loop::

    with WorkerSession("http://127.0.0.1:8000", token, "my-agent") as session:
        while True:
            drive = session.acquire()
            while drive is not None and not drive.done:
                session.step(drive, {ego: decide(seen) for ego, seen in drive.observations.items()})

A step may be sent again after any failure of the network; the server answers the same tick with the same reply.
"""

from __future__ import annotations

import ssl
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from http.client import HTTPConnection, HTTPException, HTTPSConnection
from types import TracebackType
from typing import Any, Literal, Self
from urllib.parse import urlsplit

import msgspec
import numpy as np

from dohyo.service.wire import Format, arrays, decode, encode, pack
from dohyo.sumo_networks.envs.driving_env import Observation
from dohyo.sumo_networks.errors import DohyoError, InvalidInputError
from dohyo.sumo_networks.scenario import Mission

ACQUIRE_S = 20.0
REPLY_S = 150.0  # a tick of a large network may take its time
FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.2, 5.0
LONGEST_TEXT = 500


class WireError(DohyoError):
    """The service refuses.

    Attributes:
        status: Of HTTP.
        retry_s: When to try again, where the service said so.
    """

    def __init__(self, status: int, detail: str, retry_s: float | None = None) -> None:
        super().__init__(f"{detail} (HTTP {status})")
        self.status, self.detail, self.retry_s = status, detail, retry_s


class LeaseLostError(WireError):
    """410: the episode is no longer this worker's."""


class BadActionError(WireError):
    """422: the action cannot be taken; another one may be sent until it is due."""


class UnknownWorkerError(WireError):
    """401: the service does not know this worker, as after its restart: register again."""


class UnreachableError(DohyoError):
    """Nobody answers at the address."""


_ERRORS = {401: UnknownWorkerError, 410: LeaseLostError, 422: BadActionError}


@dataclass(slots=True)
class Drive:
    """An episode on lease, as its worker knows it.

    Attributes:
        lease: Identifier.
        attempt: From 1.
        deadline_s: For one decision.
        first_deadline_s: For the first one.
        slow_policy: Whether the simulation waits.
        spec: name, version, track, sensors, control and settings, as submitted.
        missions: By ego.
        seed: For `Agent.reset`.
        tick: To be decided.
        observations: At that tick, by ego and sensor.
        time_s: Simulated time of the tick.
        done: Whether the episode is over.
        missed: Ticks that went by without a decision.
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
        """From the answer to an acquire."""
        return cls(
            lease=answer["lease"],
            attempt=answer["attempt"],
            deadline_s=answer["deadline_ms"] / 1000,
            first_deadline_s=answer["first_deadline_ms"] / 1000,
            slow_policy=answer["slow_policy"],
            spec=answer["spec"],
            missions={one["name"]: Mission.model_validate(one) for one in answer["missions"]},
            seed=answer["seed"],
            tick=answer["tick"],
            observations=arrays(answer["observations"]),
        )

    def take(self, answer: Mapping[str, Any]) -> None:
        """The answer to a step."""
        self.tick, self.time_s = answer["tick"], answer["time_s"]
        self.observations = arrays(answer["observations"])
        self.done, self.missed, self.directive = answer["done"], answer["missed"], answer["directive"]


class Connection:
    """One kept HTTP connection that speaks msgpack; opened again whenever it breaks."""

    def __init__(self, url: str, timeout_s: float = REPLY_S) -> None:
        """Connects at the first request.

        Args:
            url: Of the service, http or https.
            timeout_s: For any answer.

        Raises:
            InvalidInputError: It is no such address.
        """
        parts = urlsplit(url)
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise InvalidInputError(f"expected the service's address, such as http://127.0.0.1:8000, got '{url}'")
        self._secure, self._host, self._port = parts.scheme == "https", parts.hostname, parts.port
        self._prefix, self._timeout_s = parts.path.rstrip("/"), timeout_s
        self._connection: HTTPConnection | None = None

    def post(self, path: str, document: Any, token: str) -> Any:
        """Sends a document, and returns the one that comes back; None for an empty answer.

        Raises:
            WireError: The service refuses.
            UnreachableError: The connection failed, before or after the service had read the request.
        """
        headers = {"authorization": f"Bearer {token}", "content-type": Format.MSGPACK.value}
        try:
            if self._connection is None:
                self._connection = self._open()
            self._connection.request("POST", self._prefix + path, encode(document, Format.MSGPACK), headers)
            response = self._connection.getresponse()
            body = response.read()
        except (OSError, HTTPException) as error:
            self.close()
            raise UnreachableError(f"no answer from {self._host}: {type(error).__name__}: {error}") from error
        except BaseException:  # interrupted: what comes next on this connection would be another's answer
            self.close()
            raise
        if response.status >= 400:
            raise _refusal(response.status, body, response.getheader("retry-after"))
        return decode(body, Format.MSGPACK) if body else None

    def close(self) -> None:
        """Closes the connection."""
        if self._connection is not None:
            self._connection.close()
            self._connection = None

    def _open(self) -> HTTPConnection:
        if not self._secure:
            return HTTPConnection(self._host, self._port, timeout=self._timeout_s)
        context = ssl.create_default_context()
        return HTTPSConnection(self._host, self._port, timeout=self._timeout_s, context=context)


class WorkerSession:
    """A registered worker; not for several threads at once, `heartbeat` apart.

    Attributes:
        lease_ttl_s: Silent for longer, it loses its lease.
        heard: When the service last had a sign of life, monotonic.
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
            url: Of the service.
            token: Of role worker or submitter.
            agent: Its name.
            version: Of the agent; None: whichever.
            capacity: Episodes at once.
            patience_s: How long a step is tried again while the service cannot be reached.
        """
        self._connection, self._pulse = Connection(url), Connection(url, timeout_s=10.0)
        self._api_token, self._agent, self._version, self._capacity = token, agent, version, capacity
        self._patience_s = patience_s
        self._worker = self._token = ""
        self._pulse_lock = threading.Lock()
        self.lease_ttl_s = 30.0
        self.heard = time.monotonic()

    def register(self) -> None:
        """Introduces the worker, anew if it was known.

        Raises:
            WireError: The token is not good for this agent.
            UnreachableError: Nobody answers.
        """
        order = {"agent": self._agent, "capacity": self._capacity, "version": self._version}
        try:
            answer = self._connection.post("/v1/workers", order, self._api_token)
        except UnknownWorkerError as error:
            raise WireError(error.status, error.detail) from error  # the token itself: registering again is no help
        self._worker, self._token, self.lease_ttl_s = answer["worker"], answer["token"], answer["lease_ttl_s"]

    def acquire(self, wait_s: float = ACQUIRE_S) -> Drive | None:
        """Waits for an episode; None where none came in time.

        Raises:
            UnknownWorkerError: The service has forgotten this worker; the next call introduces it again.
            WireError: The service refuses.
            UnreachableError: Nobody answers.
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

    def step(self, drive: Drive, actions: Mapping[str, Any]) -> None:
        """Sends the decisions of all egos, and moves the drive on to what they led to.

        Raises:
            BadActionError: One cannot be taken; others may be sent.
            LeaseLostError: The episode is no longer this worker's.
            UnreachableError: Nobody answers, not even after `patience_s`.
        """
        packed = {ego: pack(np.asarray(action)) for ego, action in actions.items()}
        answer = self._insist(f"/v1/leases/{drive.lease}/step", {"tick": drive.tick, "actions": packed})
        self.heard = time.monotonic()
        drive.take(answer)

    def heartbeat(self, drive: Drive) -> None:
        """Tells that a decision is still on its way; from any thread.

        Raises:
            LeaseLostError: The episode is no longer this worker's.
            UnreachableError: Nobody answers.
        """
        with self._pulse_lock:
            self._pulse.post(f"/v1/leases/{drive.lease}/heartbeat", {}, self._token)
        self.heard = time.monotonic()

    def release(self, drive: Drive, reason: str = "", error: str | None = None) -> None:
        """Gives an episode back: because the agent failed, where there is an `error`; else to be driven again.

        Raises:
            WireError: The episode is no longer this worker's.
            UnreachableError: Nobody answers.
        """
        document = {"reason": reason[:LONGEST_TEXT], "error": error[:LONGEST_TEXT] if error is not None else None}
        self._connection.post(f"/v1/leases/{drive.lease}/release", document, self._token)

    def close(self) -> None:
        """Closes the connections; an episode on lease is lost by its silence."""
        self._connection.close()
        self._pulse.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        self.close()

    def _insist(self, path: str, document: Any) -> Any:
        """Sends a request that may be sent twice, until it is answered."""
        ends, pauses = time.monotonic() + self._patience_s, Pauses()
        while True:
            try:
                return self._connection.post(path, document, self._token)
            except UnknownWorkerError as error:
                self._worker = ""  # the service was started anew, and the episode with it
                raise LeaseLostError(410, error.detail) from error
            except (UnreachableError, WireError) as error:
                temporary = isinstance(error, UnreachableError) or error.status in (429, 503)
                if not temporary or time.monotonic() > ends:
                    raise
                time.sleep(pauses.next(error))


@dataclass(slots=True)
class Pauses:
    """Ever longer pauses between attempts, or what the service asks for."""

    _seconds: float = field(default=FIRST_PAUSE_S)

    def next(self, error: Exception | None = None) -> float:
        """Seconds to wait now."""
        told = error.retry_s if isinstance(error, WireError) else None
        pause, self._seconds = self._seconds, min(self._seconds * 2, LONGEST_PAUSE_S)
        return told if told is not None else pause

    def reset(self) -> None:
        """It went well."""
        self._seconds = FIRST_PAUSE_S


def _refusal(status: int, body: bytes, retry_after: str | None) -> WireError:
    try:
        document = msgspec.json.decode(body)
        detail = str(document["detail"])
    except (msgspec.DecodeError, KeyError, TypeError):
        detail = body[:200].decode(errors="replace") or "no reason given"
    retry_s = float(retry_after) if retry_after is not None and retry_after.isdigit() else None
    return _ERRORS.get(status, WireError)(status, detail, retry_s)
