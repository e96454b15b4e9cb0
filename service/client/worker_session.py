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
import ssl
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.client import HTTPConnection, HTTPException, HTTPResponse, HTTPSConnection
from types import TracebackType
from typing import Any, Literal, Self
from urllib.parse import urlsplit

import msgspec
import numpy as np

from dohyo.service.wire.foreign import Answer, media_type, redirection, told
from dohyo.service.wire.messages import Format, arrays, decode, encode, pack
from dohyo.sumo_networks.errors import DohyoError, InvalidInputError
from dohyo.sumo_networks.scenario import Mission
from dohyo.sumo_networks.sensors import Observation

ACQUIRE_S = 20.0
REPLY_S = 150.0  # a tick of a large network may be slow
IDLE_S = 30.0  # well below the time after which the service closes a connection that nobody uses
FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.2, 5.0
LONGEST_TEXT = 500
NO_CONTENT = 204
FULL = 409  # the service has not noticed yet that this worker holds no episode any more
PASSING = (429, 500, 502, 503, 504)
"""Refusals that end by themselves; a proxy answers with 502 or 504 while the service behind it restarts."""
UNTOLD = {"start": {"lane": "untold"}, "goal": {"lane": "untold"}}

logger = logging.getLogger("dohyo.worker")


class WireError(DohyoError):
    """A refusal of the service.

    Attributes:
        status: HTTP status.
        retry_s: Seconds to wait before a retry, where the service gave them.
    """

    def __init__(self, status: int, detail: str, retry_s: float | None = None) -> None:
        super().__init__(f"{detail} (HTTP {status})")
        self.status, self.detail, self.retry_s = status, detail, retry_s


class LeaseLostError(WireError):
    """410: the lease is lost."""


class BadActionError(WireError):
    """422: the action is invalid; another one may be sent before the deadline."""


class UnknownWorkerError(WireError):
    """401: the service does not know this worker, for example after a restart: register again."""


class UnreachableError(DohyoError):
    """No service answers at the address."""


class ForeignAnswerError(UnreachableError):
    """Something else than a dohyo service answers at the address, such as a proxy while the service restarts."""


def passes(error: UnreachableError | WireError) -> bool:
    """Whether the same request may be answered later."""
    return isinstance(error, UnreachableError) or error.status in PASSING


_ERRORS = {401: UnknownWorkerError, 410: LeaseLostError, 422: BadActionError}


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


class Connection:
    """A persistent HTTP connection with msgpack bodies; reopened after a failure."""

    def __init__(self, url: str, timeout_s: float = REPLY_S) -> None:
        """Connects at the first request.

        Args:
            url: Address of the service, http or https.
            timeout_s: Time limit of an answer.

        Raises:
            InvalidInputError: The address is invalid.
        """
        parts = urlsplit(url)
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise InvalidInputError(f"expected the service's address, such as http://127.0.0.1:8000, got '{url}'")
        self._url = url
        self._secure, self._host, self._port = parts.scheme == "https", parts.hostname, parts.port
        self._prefix, self._timeout_s = parts.path.rstrip("/"), timeout_s
        self._connection: HTTPConnection | None = None
        self._used = 0.0  # monotonic time

    def post(self, path: str, document: Any, token: str) -> Any:
        """Sends a document and returns the answer; None for an empty one.

        Raises:
            WireError: The service refuses.
            UnreachableError: The connection failed, before or after the service had read the request.
        """
        self.send("POST", path, document, token)
        return self.receive()

    def send(
        self, method: str, path: str, document: Any, token: str, fmt: Format = Format.MSGPACK, key: str | None = None
    ) -> None:
        """Sends a request, whose answer `receive` must read; without a document it has no body.

        Args:
            method: Such as "POST".
            path: Under the service's address.
            document: What is sent, in a format.
            token: Bearer token.
            fmt: Format of the document; the answer may be in either.
            key: Header `Idempotency-Key`; None: without.

        Raises:
            UnreachableError: The connection failed.
        """
        headers = {"authorization": f"Bearer {token}", "accept": Format.MSGPACK.value}
        headers |= {"idempotency-key": key} if key is not None else {}
        body = None
        if document is not None:
            headers["content-type"], body = fmt.value, encode(document, fmt)
        if time.monotonic() - self._used > IDLE_S:
            self.close()  # the service may have closed its end, which shows only after a request has gone
        self._used = time.monotonic()
        with self._one_answer():
            if self._connection is None:
                self._connection = self._open()
            self._connection.request(method, self._prefix + path, body, headers)

    def receive(self) -> Any:
        """The answer to the request that was sent; None for an empty one.

        Raises:
            WireError: The service refuses, or another address is told.
            ForeignAnswerError: Something else than a service answers.
            UnreachableError: The connection failed, before or after the service had read the request.
        """
        assert self._connection is not None
        with self._one_answer():
            response = self._connection.getresponse()
            body = response.read()
        self._used = time.monotonic()
        if response.status >= 400:
            raise _refusal(self._url, response, body)
        if response.status >= 300:
            raise WireError(response.status, told(self._url, redirection(response.getheader("location"))))
        return self._document(body, response.getheader("content-type")) if response.status != NO_CONTENT else None

    def _document(self, body: bytes, content_type: str | None) -> Any:
        sent = media_type(content_type) or Format.MSGPACK.value
        try:
            document = decode(body, Format(sent))
        except InvalidInputError:
            raise self._foreign(f"{sent} that cannot be read") from None
        except ValueError:
            raise self._foreign(sent) from None
        return Answer(document, self._foreign) if isinstance(document, dict) else document

    def _foreign(self, sent: str) -> ForeignAnswerError:
        return ForeignAnswerError(told(self._url, sent))

    @contextmanager
    def _one_answer(self) -> Iterator[None]:
        """Closes the connection after a failure: its next answer would belong to another request."""
        try:
            yield
        except (OSError, HTTPException) as error:
            self.close()
            raise UnreachableError(f"no answer from {self._host}: {type(error).__name__}: {error}") from error
        except BaseException:
            self.close()
            raise

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


@dataclass(slots=True)
class Pauses:
    """Growing pauses between attempts, or those that the service asks for."""

    _seconds: float = field(default=FIRST_PAUSE_S)

    def next(self, error: Exception | None = None) -> float:
        """Seconds to wait now."""
        told = error.retry_s if isinstance(error, WireError) else None
        pause, self._seconds = self._seconds, min(self._seconds * 2, LONGEST_PAUSE_S)
        return told if told is not None else pause

    def reset(self) -> None:
        """Resets the pause after a success."""
        self._seconds = FIRST_PAUSE_S


def _refusal(url: str, response: HTTPResponse, body: bytes) -> WireError:
    try:
        document = msgspec.json.decode(body)
        detail = str(document["detail"])
    except (msgspec.DecodeError, KeyError, TypeError):
        sent = media_type(response.getheader("content-type"))
        text = body[:200].decode(errors="replace") or "no reason given"
        detail = told(url, sent) if sent == "text/html" else text
    retry_after = response.getheader("retry-after")
    retry_s = float(retry_after) if retry_after is not None and retry_after.isdigit() else None
    return _ERRORS.get(response.status, WireError)(response.status, detail, retry_s)
