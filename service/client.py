"""Client and AsyncClient: the service from Python.

    with Client("http://127.0.0.1:8000", token) as client:
        client.register_agent("my-autopilot")
        client.submit_builtin("my-autopilot", "autopilot")
        evaluation = client.evaluate("my-autopilot", "quickstart", seeds=[0, 1])
        client.wait(evaluation["id"])
        print(client.leaderboard("quickstart"))

Both have the same methods; those of AsyncClient are awaited. Answers are the service's JSON documents. A policy worker
speaks another, faster way: see `service.worker_session`.
"""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import AsyncIterator, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Self
from urllib.parse import quote

import httpx

from evaluation.record import AgentInfo
from evaluation.store import write_atomically
from service.worker_session import WorkerSession
from sumo_networks.errors import DohyoError, InvalidInputError

Document = dict[str, Any]
ENDED = ("done", "failed", "cancelled")
TIMEOUT_S = 60.0
POLL_S = 1.0


class ServiceError(DohyoError):
    """The service refuses, or cannot be reached.

    Attributes:
        status: Of HTTP; 0 where there was no answer.
        detail: What was expected and what came.
        retry_s: Seconds to wait before trying again, where the service said so.
    """

    def __init__(self, status: int, detail: str, retry_s: float | None = None) -> None:
        super().__init__(f"{detail} (HTTP {status})" if status else detail)
        self.status, self.detail, self.retry_s = status, detail, retry_s


@dataclass(frozen=True, slots=True)
class _Call:
    """A request to be sent."""

    method: str
    path: str
    query: Mapping[str, Any] | None = None
    body: Any = None
    files: Mapping[str, Any] | None = None

    def arguments(self) -> dict[str, Any]:
        """For httpx; what is None is left out."""
        query = {key: value for key, value in (self.query or {}).items() if value is not None}
        out: dict[str, Any] = {"method": self.method, "url": self.path, "params": query}
        if self.files is not None:
            out |= {"files": self.files}
        elif self.body is not None:
            out |= {"json": {key: value for key, value in self.body.items() if value is not None}}
        return out


def _one(*parts: str) -> str:
    return "/v1/" + "/".join(quote(part, safe="") for part in parts)


def _register_agent(name: str, description: str) -> _Call:
    return _Call("POST", "/v1/agents", body={"name": name, "description": description})


def _submit_builtin(agent: str, entry: str, settings: Mapping[str, Any] | None) -> _Call:
    body = {"kind": "builtin", "entry": entry, "settings": dict(settings or {})}
    return _Call("POST", _one("agents", agent, "submissions"), body=body)


def _submit_remote(agent: str, info: AgentInfo) -> _Call:
    body = {"kind": "remote", **info.model_dump(mode="json")}
    return _Call("POST", _one("agents", agent, "submissions"), body=body)


def _submit_onnx(agent: str, policy: Path, spec: Mapping[str, Any]) -> _Call:
    try:
        content = policy.read_bytes()
    except OSError as error:
        raise InvalidInputError(f"policy '{policy}' cannot be read: {error.strerror}") from error
    files = {"spec": (None, json.dumps(dict(spec)), "application/json"), "file": (policy.name, content)}
    return _Call("POST", _one("agents", agent, "submissions", "onnx"), files=files)


def _evaluate(
    agent: str,
    benchmark: str,
    version: int | None,
    seeds: Sequence[int] | None,
    slow_policy: Literal["wait", "realtime"],
    act_deadline_s: float | None,
) -> _Call:
    body = {
        "agent": agent,
        "benchmark": benchmark,
        "version": version,
        "seeds": list(seeds) if seeds is not None else None,
        "slow_policy": slow_policy,
        "act_deadline_s": act_deadline_s,
    }
    return _Call("POST", "/v1/evaluations", body=body)


def _submissions_like(listed: Document, info: AgentInfo) -> list[int]:
    """Versions among an agent's submissions that declare exactly this remote agent."""
    wanted = {"kind": "remote", **info.model_dump(mode="json")}
    return [one["version"] for one in listed["items"] if all(one.get(key) == value for key, value in wanted.items())]


def _checked(response: httpx.Response) -> httpx.Response:
    if response.is_success:
        return response
    try:
        detail = str(response.json()["detail"])
    except (ValueError, KeyError, TypeError):
        detail = response.text[:200] or "no reason given"
    told = response.headers.get("retry-after", "")
    raise ServiceError(response.status_code, detail, float(told) if told.isdigit() else None)


def _headers(token: str | None) -> dict[str, str]:
    return {"authorization": f"Bearer {token}"} if token else {}


class Client:
    """The service, call by call. Every method raises ServiceError where the service refuses or is not there."""

    def __init__(self, url: str, token: str | None = None, *, timeout_s: float = TIMEOUT_S) -> None:
        """Connects at the first call.

        Args:
            url: Such as "http://127.0.0.1:8000".
            token: None: read only what is public.
            timeout_s: For one answer.
        """
        self._url, self._token = url, token
        self._http = httpx.Client(base_url=url, headers=_headers(token), timeout=timeout_s)

    def close(self) -> None:
        """Closes the connections."""
        self._http.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        self.close()

    def _send(self, call: _Call) -> httpx.Response:
        try:
            return _checked(self._http.request(**call.arguments()))
        except httpx.HTTPError as error:
            raise ServiceError(0, f"no answer from {self._url}: {type(error).__name__}: {error}") from error

    def _json(self, call: _Call) -> Document:
        document: Document = self._send(call).json()
        return document

    def get(self, path: str, **query: Any) -> Document:
        """Any JSON document of the interface, such as `get("/v1/networks")`."""
        return self._json(_Call("GET", path, query))

    def items(self, path: str, **query: Any) -> Iterator[Document]:
        """All items of a list, page after page, such as `items("/v1/evaluations", agent="my-agent")`."""
        after: str | None = None
        while True:
            page = self.get(path, **query, after=after)
            yield from page["items"]
            after = page["next"]
            if after is None:
                return

    def register_agent(self, name: str, description: str = "") -> Document:
        """Makes an agent of the token's owner."""
        return self._json(_register_agent(name, description))

    def submit_builtin(self, agent: str, entry: str, settings: Mapping[str, Any] | None = None) -> Document:
        """Submits an agent that comes with the service."""
        return self._json(_submit_builtin(agent, entry, settings))

    def submit_onnx(self, agent: str, policy: Path, spec: Mapping[str, Any]) -> Document:
        """Submits an ONNX file; `spec` says its track, sensors and control."""
        return self._json(_submit_onnx(agent, policy, spec))

    def submit_remote(self, agent: str, info: AgentInfo) -> Document:
        """Declares an agent that drives through workers; `info` is what its records will say."""
        return self._json(_submit_remote(agent, info))

    def ensure_remote(self, agent: str, info: AgentInfo) -> int:
        """The version of an agent that declares `info`; registers the agent and submits it where it is missing."""
        try:
            listed = self.get(_one("agents", agent, "submissions"))
        except ServiceError as error:
            if error.status != 404:
                raise
            self.register_agent(agent)
            listed = {"items": []}
        there = _submissions_like(listed, info)
        return there[-1] if there else int(self.submit_remote(agent, info)["version"])

    def evaluate(
        self,
        agent: str,
        benchmark: str,
        *,
        version: int | None = None,
        seeds: Sequence[int] | None = None,
        slow_policy: Literal["wait", "realtime"] = "wait",
        act_deadline_s: float | None = None,
    ) -> Document:
        """Queues an evaluation; by default of the latest version, with the benchmark's seeds."""
        return self._json(_evaluate(agent, benchmark, version, seeds, slow_policy, act_deadline_s))

    def evaluation(self, evaluation_id: str) -> Document:
        """An evaluation as it stands."""
        return self.get(_one("evaluations", evaluation_id))

    def wait(self, evaluation_id: str, timeout_s: float | None = None) -> Document:
        """Waits until an evaluation has ended.

        Raises:
            TimeoutError: It has not, in that time.
        """
        ends = time.monotonic() + timeout_s if timeout_s is not None else None
        while (evaluation := self.evaluation(evaluation_id))["status"] not in ENDED:
            if ends is not None and time.monotonic() > ends:
                raise TimeoutError(f"evaluation '{evaluation_id}' is still {evaluation['status']}")
            time.sleep(POLL_S)
        return evaluation

    def cancel(self, evaluation_id: str) -> Document:
        """Ends an evaluation; its finished episodes stay."""
        return self._json(_Call("POST", _one("evaluations", evaluation_id, "cancel")))

    def resume(self, evaluation_id: str) -> Document:
        """Drives again what was lost or cancelled."""
        return self._json(_Call("POST", _one("evaluations", evaluation_id, "resume")))

    def episodes(self, evaluation_id: str) -> Iterator[Document]:
        """Episodes of an evaluation, in the benchmark's order."""
        return self.items(_one("evaluations", evaluation_id, "episodes"))

    def record(self, episode_id: str) -> Document:
        """The facts of an episode."""
        return self.get(_one("episodes", episode_id, "record"))

    def download(self, evaluation_id: str, folder: Path) -> list[Path]:
        """Saves the records of an evaluation; `dohyo score` and `dohyo verify` read them."""
        folder.mkdir(parents=True, exist_ok=True)
        return [self._save(episode, folder) for episode in self.episodes(evaluation_id) if episode["record_hash"]]

    def _save(self, episode: Document, folder: Path) -> Path:
        facts = folder / f"{episode['scenario']}-s{episode['seed']}.json"
        for path, part in ((facts.with_suffix(".parquet"), "trajectory"), (facts, "record")):
            write_atomically(path, self._send(_Call("GET", _one("episodes", episode["id"], part))).content)
        return facts

    def leaderboard(self, benchmark: str, *, version: str | None = None, track: str | None = None) -> Document:
        """Who drives best."""
        return self.get("/v1/leaderboard", benchmark=benchmark, version=version, track=track)

    def comparison(self, evaluation_ids: Sequence[str]) -> Document:
        """Evaluations of one benchmark version side by side."""
        return self.get("/v1/comparison", evaluation=list(evaluation_ids))

    def worker(self, agent: str, *, version: int | None = None, capacity: int = 1) -> WorkerSession:
        """The wire of a policy worker for an agent."""
        return WorkerSession(self._url, self._token or "", agent, version=version, capacity=capacity)


class AsyncClient:
    """`Client` for asyncio: the same methods, to be awaited."""

    def __init__(self, url: str, token: str | None = None, *, timeout_s: float = TIMEOUT_S) -> None:
        """See `Client`."""
        self._url = url
        self._http = httpx.AsyncClient(base_url=url, headers=_headers(token), timeout=timeout_s)

    async def close(self) -> None:
        """Closes the connections."""
        await self._http.aclose()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        await self.close()

    async def _send(self, call: _Call) -> httpx.Response:
        try:
            return _checked(await self._http.request(**call.arguments()))
        except httpx.HTTPError as error:
            raise ServiceError(0, f"no answer from {self._url}: {type(error).__name__}: {error}") from error

    async def _json(self, call: _Call) -> Document:
        document: Document = (await self._send(call)).json()
        return document

    async def get(self, path: str, **query: Any) -> Document:
        """See `Client.get`."""
        return await self._json(_Call("GET", path, query))

    async def items(self, path: str, **query: Any) -> AsyncIterator[Document]:
        """See `Client.items`."""
        after: str | None = None
        while True:
            page = await self.get(path, **query, after=after)
            for item in page["items"]:
                yield item
            after = page["next"]
            if after is None:
                return

    async def register_agent(self, name: str, description: str = "") -> Document:
        """See `Client.register_agent`."""
        return await self._json(_register_agent(name, description))

    async def submit_builtin(self, agent: str, entry: str, settings: Mapping[str, Any] | None = None) -> Document:
        """See `Client.submit_builtin`."""
        return await self._json(_submit_builtin(agent, entry, settings))

    async def submit_onnx(self, agent: str, policy: Path, spec: Mapping[str, Any]) -> Document:
        """See `Client.submit_onnx`."""
        return await self._json(await asyncio.to_thread(_submit_onnx, agent, policy, spec))

    async def submit_remote(self, agent: str, info: AgentInfo) -> Document:
        """See `Client.submit_remote`."""
        return await self._json(_submit_remote(agent, info))

    async def evaluate(
        self,
        agent: str,
        benchmark: str,
        *,
        version: int | None = None,
        seeds: Sequence[int] | None = None,
        slow_policy: Literal["wait", "realtime"] = "wait",
        act_deadline_s: float | None = None,
    ) -> Document:
        """See `Client.evaluate`."""
        return await self._json(_evaluate(agent, benchmark, version, seeds, slow_policy, act_deadline_s))

    async def evaluation(self, evaluation_id: str) -> Document:
        """See `Client.evaluation`."""
        return await self.get(_one("evaluations", evaluation_id))

    async def wait(self, evaluation_id: str, timeout_s: float | None = None) -> Document:
        """See `Client.wait`."""
        async with asyncio.timeout(timeout_s):
            while (evaluation := await self.evaluation(evaluation_id))["status"] not in ENDED:
                await asyncio.sleep(POLL_S)
        return evaluation

    async def cancel(self, evaluation_id: str) -> Document:
        """See `Client.cancel`."""
        return await self._json(_Call("POST", _one("evaluations", evaluation_id, "cancel")))

    async def resume(self, evaluation_id: str) -> Document:
        """See `Client.resume`."""
        return await self._json(_Call("POST", _one("evaluations", evaluation_id, "resume")))

    def episodes(self, evaluation_id: str) -> AsyncIterator[Document]:
        """See `Client.episodes`."""
        return self.items(_one("evaluations", evaluation_id, "episodes"))

    async def record(self, episode_id: str) -> Document:
        """See `Client.record`."""
        return await self.get(_one("episodes", episode_id, "record"))

    async def leaderboard(self, benchmark: str, *, version: str | None = None, track: str | None = None) -> Document:
        """See `Client.leaderboard`."""
        return await self.get("/v1/leaderboard", benchmark=benchmark, version=version, track=track)

    async def comparison(self, evaluation_ids: Sequence[str]) -> Document:
        """See `Client.comparison`."""
        return await self.get("/v1/comparison", evaluation=list(evaluation_ids))
