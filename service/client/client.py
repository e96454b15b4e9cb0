# Generated from async_client.py by `python -m dohyo.service.client.generate`: edit that file.
"""Client: access to the service from Python.

    with Client("http://127.0.0.1:8000", token) as client:
        client.register_agent("my-autopilot")
        client.submit_builtin("my-autopilot", "autopilot")
        evaluation = client.evaluate("my-autopilot", "quickstart", seeds=[0, 1])
        client.wait(evaluation["id"])
        print(client.leaderboard("quickstart"))

Answers are the service's JSON documents, with types in `dohyo.service.client.answers`. Policy workers use a faster
connection: see `dohyo.service.client.worker_session`.
"""

from __future__ import annotations

import json
import time
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Self, TypeVar, cast

import httpx

from dohyo.evaluation.records.record import AgentInfo
from dohyo.service.client.answers import (
    AgentView,
    ComparedView,
    CrossPlayView,
    EpisodeView,
    EvaluationView,
    LeaderboardView,
    MetricsView,
    SubmissionView,
    WorldGuestView,
    WorldInvitationView,
    WorldView,
)
from dohyo.service.client.calls import ENDED, Call, Document, headers_of, path_of, remote_of, versions_like
from dohyo.service.client.downloads import Download, check_size
from dohyo.service.client.errors import HTML, ForeignAnswerError, ServiceError, check, document_of
from dohyo.service.client.events import HEARTBEAT_S, MEDIA_TYPE, SILENCE_S, Event, EventParser
from dohyo.service.client.worker_session import WorkerSession
from dohyo.service.wire.foreign import media_type
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import write_atomically

TIMEOUT_S = 60.0
PATIENCE_S = 120.0  # as a worker has: a restart of the service with all that it loads
T = TypeVar("T")
POLL_S = 1.0


class Client:
    """Every method raises ServiceError where the service refuses or cannot be reached."""

    def __init__(
        self, url: str, token: str | None = None, *, timeout_s: float = TIMEOUT_S, patience_s: float = PATIENCE_S
    ) -> None:
        """Connects at the first call.

        Args:
            url: Such as "http://127.0.0.1:8000".
            token: None: read only what is public.
            timeout_s: For one answer.
            patience_s: Longest time for which a call waits for a busy service, and for which a GET is repeated while a
                proxy answers for the service, such as during a restart. `wait` and `follow` go on without any answer,
                too.
        """
        self._url, self._token, self._patience_s = url, token, patience_s
        self._known = False  # whether a service has answered
        self._http = httpx.Client(base_url=url, headers=headers_of(token), timeout=timeout_s)

    def close(self) -> None:
        """Closes the connections."""
        self._http.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        self.close()

    def get(self, path: str, **query: Any) -> Document:
        """Any JSON document of the interface, such as `get("/v1/networks")`."""
        return self._json(Document, Call("GET", path, query))

    def items(self, path: str, **query: Any) -> Iterator[Document]:
        """All items of a paged list, such as `items("/v1/evaluations", agent="my-agent")`."""
        after: str | None = None
        while True:
            page = self.get(path, **query, after=after)
            for item in page["items"]:
                yield item
            after = page["next"]
            if after is None:
                return

    def register_agent(self, name: str, description: str = "") -> AgentView:
        """Registers an agent of the token's owner."""
        return self._json(AgentView, Call("POST", "/v1/agents", body={"name": name, "description": description}))

    def ensure_agent(self, name: str, description: str = "") -> AgentView:
        """The agent of that name; registers it where it is missing."""
        try:
            return self._json(AgentView, Call("GET", path_of("agents", name)))
        except ServiceError as error:
            if error.status != 404:
                raise
        return self.register_agent(name, description)

    def submit_builtin(self, agent: str, entry: str, settings: Mapping[str, Any] | None = None) -> SubmissionView:
        """Submits a built-in agent of the service."""
        return self._submit(agent, {"kind": "builtin", "entry": entry, "settings": dict(settings or {})})

    def submit_remote(self, agent: str, info: AgentInfo) -> SubmissionView:
        """Declares an agent that drives through workers; `info` appears in its records."""
        return self._submit(agent, remote_of(info))

    def submit_onnx(self, agent: str, policy: Path, spec: Mapping[str, Any]) -> SubmissionView:
        """Submits an ONNX file; `spec` gives its track, sensors and control.

        Raises:
            InvalidInputError: The file cannot be read.
        """
        try:
            content = policy.read_bytes()
        except OSError as error:
            raise InvalidInputError(f"policy '{policy}' cannot be read: {error.strerror}") from error
        files = {"spec": (None, json.dumps(dict(spec)), "application/json"), "file": (policy.name, content)}
        path = path_of("agents", agent, "submissions", "onnx")
        return self._json(SubmissionView, Call("POST", path, files=files))

    def ensure_remote(self, agent: str, info: AgentInfo) -> int:
        """The version of an agent that declares `info`; registers and submits it where it is missing."""
        self.ensure_agent(agent)
        there = versions_like(self.get(path_of("agents", agent, "submissions")), info)
        return there[-1] if there else int((self.submit_remote(agent, info))["version"])

    def evaluate(
        self,
        agent: str,
        benchmark: str,
        *,
        version: int | None = None,
        seeds: Sequence[int] | None = None,
        slow_policy: Literal["wait", "realtime"] | None = None,
        act_deadline_s: float | None = None,
        ranked: bool = False,
        ranking: str | None = None,
        egos: Mapping[str, Mapping[str, Any]] | None = None,
    ) -> EvaluationView:
        """Queues an evaluation, by default a practice run of the latest version with the benchmark's seeds.

        A ranked run may enter a board, counts against a quota, and takes all conditions from its ranking: that of
        `ranking`, a phase of a challenge, or the benchmark's open one. In a mixed run `egos` names the agents of single
        egos, such as {"west-1": {"agent": "mbappe", "version": 2}}, and `agent` drives the others.
        """
        body = {
            "agent": agent,
            "benchmark": benchmark,
            "version": version,
            "seeds": list(seeds) if seeds is not None else None,
            "slow_policy": slow_policy,
            "act_deadline_s": act_deadline_s,
            "ranked": ranked,
            "ranking": ranking,
            "egos": egos or None,
        }
        return self._json(EvaluationView, Call("POST", "/v1/evaluations", body=body))

    def evaluation(self, evaluation_id: str) -> EvaluationView:
        """State of an evaluation."""
        return self._json(EvaluationView, Call("GET", path_of("evaluations", evaluation_id)))

    def follow(self, evaluation_id: str) -> Iterator[EvaluationView]:
        """States of an evaluation, one at each event of it; the last one is its end."""
        path = path_of("evaluations", evaluation_id)
        return cast(Iterator[EvaluationView], self._follow(path, f"{path}/progress"))

    def wait(self, evaluation_id: str, timeout_s: float | None = None) -> EvaluationView:
        """Waits until an evaluation has ended.

        Raises:
            TimeoutError: The evaluation did not end in that time.
        """
        path = path_of("evaluations", evaluation_id)
        return cast(EvaluationView, self._wait(path, f"{path}/progress", timeout_s))

    def cancel(self, evaluation_id: str) -> EvaluationView:
        """Cancels an evaluation; finished episodes are kept."""
        return self._json(EvaluationView, Call("POST", path_of("evaluations", evaluation_id, "cancel")))

    def resume(self, evaluation_id: str) -> EvaluationView:
        """Queues lost and cancelled episodes again."""
        return self._json(EvaluationView, Call("POST", path_of("evaluations", evaluation_id, "resume")))

    def metrics(self, evaluation_id: str) -> MetricsView:
        """Scores of an evaluation with intervals, over the finished episodes."""
        return self._json(MetricsView, Call("GET", path_of("evaluations", evaluation_id, "metrics")))

    def manifest(self, evaluation_id: str) -> Document:
        """Manifest of an evaluation, as in a result folder of `dohyo evaluate`."""
        return self.get(path_of("evaluations", evaluation_id, "manifest"))

    def episodes(self, evaluation_id: str) -> Iterator[EpisodeView]:
        """Episodes of an evaluation, in the benchmark's order."""
        return cast(Iterator[EpisodeView], self.items(path_of("evaluations", evaluation_id, "episodes")))

    def record(self, episode_id: str) -> Document:
        """Record of an episode."""
        return self.get(path_of("episodes", episode_id, "record"))

    def download(self, evaluation_id: str, folder: Path) -> list[Path]:
        """Saves the records of an evaluation with their signatures; `dohyo score` and `dohyo verify` read them.

        Raises:
            InvalidInputError: The server sent a record of another episode, a wrong signature, or a name that cannot be
                a file name. Records before it are saved.
        """
        folder.mkdir(parents=True, exist_ok=True)
        paths: list[Path] = []
        for episode in self.episodes(evaluation_id):
            if episode["record_hash"]:
                download = Download(episode, folder)
                if download.path in paths:
                    raise InvalidInputError(f"the server lists '{download.path.name}' twice")
                for part, call, limit in download.parts:
                    for path, content in download.files(part, *self._load(call, limit)):
                        write_atomically(path, content)
                paths.append(download.path)
        return paths

    def leaderboard(
        self,
        benchmark: str | None = None,
        *,
        version: str | None = None,
        track: str | None = None,
        ranking: str | None = None,
        limit: int = 100,
        after: str | None = None,
    ) -> LeaderboardView:
        """A page of a benchmark's open leaderboard, or with `ranking` of a challenge's phase."""
        what = {"benchmark": benchmark, "version": version, "track": track, "ranking": ranking}
        query = what | {"limit": limit, "after": after}
        return self._json(LeaderboardView, Call("GET", "/v1/leaderboard", query))

    def cross_play(self, benchmark: str, *, version: str | None = None) -> CrossPlayView:
        """Score of each agent beside each other one in mixed runs."""
        path = path_of("benchmarks", benchmark, "cross-play")
        return self._json(CrossPlayView, Call("GET", path, {"version": version}))

    def comparison(self, evaluation_ids: Sequence[str]) -> ComparedView:
        """Evaluations of one benchmark version side by side."""
        query = {"evaluation": list(evaluation_ids)}
        return self._json(ComparedView, Call("GET", "/v1/comparison", query))

    def worker(self, agent: str, *, version: int | None = None, capacity: int = 1) -> WorkerSession:
        """A session of a policy worker for an agent; it blocks, so an event loop runs it in another thread."""
        return WorkerSession(self._url, self._token or "", agent, version=version, capacity=capacity)

    def create_world(self, order: Mapping[str, Any]) -> WorldView:
        """Starts a live world; see `POST /v1/worlds` for the order, such as {"benchmark": "fleet", "record": True}."""
        return self._json(WorldView, Call("POST", path_of("worlds"), body=order))

    def world(self, world_id: str) -> WorldView:
        """A world with its tick, its egos and their drivers."""
        return self._json(WorldView, Call("GET", path_of("worlds", world_id)))

    def pause_world(self, world_id: str) -> WorldView:
        """Lets a world stand still after its present tick."""
        return self._json(WorldView, Call("POST", path_of("worlds", world_id, "pause")))

    def step_world(self, world_id: str, ticks: int = 1) -> WorldView:
        """Lets a paused world go on for some ticks."""
        return self._json(WorldView, Call("POST", path_of("worlds", world_id, "step"), body={"ticks": ticks}))

    def resume_world(self, world_id: str) -> WorldView:
        """Lets a world tick, also before every ego has a driver."""
        return self._json(WorldView, Call("POST", path_of("worlds", world_id, "resume")))

    def reset_world(self, world_id: str, seed: int | None = None) -> WorldView:
        """Begins a world anew at tick 0, with another seed if one is given."""
        return self._json(WorldView, Call("POST", path_of("worlds", world_id, "reset"), body={"seed": seed}))

    def end_world(self, world_id: str) -> WorldView:
        """Ends a world, and waits for its record if it has one."""
        return self._json(WorldView, Call("POST", path_of("worlds", world_id, "end")))

    def world_record(self, world_id: str) -> Document:
        """The record of a world that has ended, as `dohyo score` reads it."""
        return self._json(Document, Call("GET", path_of("worlds", world_id, "record")))

    def invite_to_world(
        self, world_id: str, egos: Sequence[str] | None = None, *, coupled: bool = False
    ) -> WorldInvitationView:
        """Makes a code with which another owner's workers join a live world, to drive some egos or all."""
        body = {"egos": None if egos is None else list(egos), "coupled": coupled}
        path = path_of("worlds", world_id, "invitations")
        return self._json(WorldInvitationView, Call("POST", path, body=body))

    def guests(self, world_id: str) -> Iterator[WorldGuestView]:
        """Guests of a world of yours, by their names."""
        return cast(Iterator[WorldGuestView], self.items(path_of("worlds", world_id, "guests")))

    def dismiss_guest(self, world_id: str, owner: str) -> None:
        """Dismisses a guest of a world of yours: its workers lose their places, and it sees the world no more."""
        self._send(Call("DELETE", path_of("worlds", world_id, "guests", owner)))

    def _submit(self, agent: str, body: Mapping[str, Any]) -> SubmissionView:
        return self._json(SubmissionView, Call("POST", path_of("agents", agent, "submissions"), body=body))

    def _json(self, kind: type[T], call: Call) -> T:
        """Document of an answer, which is of this kind; where the answer is a job, waits for its end."""
        answer, document = self._send(call)
        while answer.status_code == httpx.codes.ACCEPTED:
            place = answer.headers.get("location", "").rpartition("/")[2]
            path = path_of("jobs", place)  # never another server's address
            job = self._wait(path, f"{path}/events", None)
            if job["status"] != "done":
                raise ServiceError.of_job(job)
            if call.method != "GET":
                return cast(T, job["answer"])
            answer, document = self._send(call)  # the job has made what was asked for
        return cast(T, document)

    def _send(self, call: Call) -> tuple[httpx.Response, Any]:
        """Answer to a request, and its document."""
        until = time.monotonic() + self._patience_s
        while True:
            try:
                return self._request(call)
            except ServiceError as error:
                self._pause(call, error, until)

    def _load(self, call: Call, limit_bytes: int) -> tuple[bytes, httpx.Headers]:
        """Content of an answer, unpacked and not larger than a limit, and its headers."""
        until = time.monotonic() + self._patience_s
        while True:
            try:
                return self._receive(call, limit_bytes)
            except ServiceError as error:
                self._pause(call, error, until)

    def _pause(self, call: Call, error: ServiceError, until: float) -> None:
        """Waits before a request is sent again; raises the error where that would be in vain or too late."""
        # 429 is a refusal before any work; a proxy's 502 to 504 may follow it, so an order is not repeated.
        away = error.away and call.method == "GET"
        pause_s = POLL_S if away and error.retry_s is None else error.retry_s
        if not (away or error.status == 429) or pause_s is None or time.monotonic() + pause_s > until:
            raise error
        time.sleep(pause_s)

    def _request(self, call: Call) -> tuple[httpx.Response, Any]:
        """Answer to a request, asked for once, and its document; None where it has none."""
        try:
            answer = check(self._http.request(**call.arguments()), self._url)
        except httpx.HTTPError as error:
            raise ServiceError.unreachable(self._url, error) from error
        empty = answer.status_code == httpx.codes.NO_CONTENT
        document = None if empty else document_of(answer, self._url, known=self._known)
        self._known = True
        return answer, document

    def _receive(self, call: Call, limit_bytes: int) -> tuple[bytes, httpx.Headers]:
        content = bytearray()
        try:
            with self._http.stream(**call.arguments()) as response:
                if not response.is_success:
                    response.read()
                check(response, self._url)
                if (sent := media_type(response.headers.get("content-type"))) == HTML:
                    raise ForeignAnswerError(self._url, sent, known=self._known)
                for chunk in response.iter_bytes():
                    content += chunk
                    check_size(content, limit_bytes, call)
        except httpx.HTTPError as error:
            raise ServiceError.unreachable(self._url, error) from error
        return bytes(content), response.headers

    def _wait(self, path: str, events: str, timeout_s: float | None) -> Document:
        """State of an evaluation or a job at its end.

        Raises:
            TimeoutError: It did not end in that time.
        """
        for state in self._follow(path, events, timeout_s):
            if state["status"] in ENDED:
                return state
        raise TimeoutError(f"'{path}' has not ended in {timeout_s:g} s")

    def _follow(self, path: str, events: str, timeout_s: float | None = None) -> Iterator[Document]:
        """States of an evaluation or a job until its end, by events, and by polling where there are none."""
        ends = time.monotonic() + timeout_s if timeout_s is not None else float("inf")
        parser = EventParser(retry_s=POLL_S)
        while True:
            pause_s = POLL_S
            # A stream wakes its reader with each heartbeat, so the last seconds before a time limit are polled.
            if time.monotonic() + HEARTBEAT_S < ends:
                try:
                    with closing(self._events(events, parser, ends)) as stream:
                        for event in stream:
                            state = event.document if event.has_state else self._asked(path)
                            yield state
                            if state["status"] in ENDED:
                                return
                    pause_s = parser.retry_s
                except ServiceError as error:
                    pause_s = parser.retry_s if error.retry_s is None else error.retry_s
            state = self._state(path, ends)
            yield state
            left_s = ends - time.monotonic()
            if state["status"] in ENDED or left_s <= 0.0:
                return
            time.sleep(min(pause_s, left_s))

    def _state(self, path: str, ends: float) -> Document:
        """State of an evaluation or a job; asks again while the service cannot answer, until patience or time ends."""
        until = min(ends, time.monotonic() + self._patience_s)
        while True:
            try:
                return self._asked(path)
            except ServiceError as error:
                pause_s = POLL_S if error.retry_s is None else error.retry_s
                if not error.passes or time.monotonic() + pause_s > until:
                    raise
            time.sleep(pause_s)

    def _asked(self, path: str) -> Document:
        """Document of a path, asked for once."""
        return cast(Document, (self._request(Call("GET", path)))[1])

    def _events(self, path: str, parser: EventParser, ends: float) -> Generator[Event, None, None]:
        """Events of a stream until it closes, is silent for too long, or a time limit is near."""
        timeout = httpx.Timeout(TIMEOUT_S, read=min(SILENCE_S, ends - time.monotonic()))
        try:
            with self._http.stream("GET", path, headers=parser.headers, timeout=timeout) as response:
                if not response.is_success:
                    response.read()
                if not check(response, self._url).headers.get("content-type", "").startswith(MEDIA_TYPE):
                    return
                for line in response.iter_lines():
                    event = parser.feed(line)
                    if event is not None:
                        yield event
                    if time.monotonic() + HEARTBEAT_S >= ends:
                        return
        except httpx.HTTPError as error:
            raise ServiceError.unreachable(self._url, error) from error
