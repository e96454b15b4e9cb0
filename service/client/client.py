"""Client and AsyncClient: access to the service from Python.

    with Client("http://127.0.0.1:8000", token) as client:
        client.register_agent("my-autopilot")
        client.submit_builtin("my-autopilot", "autopilot")
        evaluation = client.evaluate("my-autopilot", "quickstart", seeds=[0, 1])
        client.wait(evaluation["id"])
        print(client.leaderboard("quickstart"))

Both have the same methods; those of AsyncClient are awaited. Answers are the service's JSON documents. Policy workers
use a faster connection: see `dohyo.service.client.worker_session`.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Awaitable, Iterator
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import httpx

from dohyo.evaluation.records.record import AgentInfo
from dohyo.service.client.calls import Call, Calls, Document, path_of
from dohyo.service.client.downloads import Download
from dohyo.service.client.worker_session import WorkerSession
from dohyo.sumo_networks.errors import DohyoError, InvalidInputError
from dohyo.sumo_networks.files import write_atomically

ENDED = ("done", "failed", "cancelled")
ACCEPTED = 202  # the answer is a job that has not ended
TIMEOUT_S = 60.0
POLL_S = 1.0


class ServiceError(DohyoError):
    """A refusal of the service, or a service that cannot be reached.

    Attributes:
        status: HTTP status; 0 without an answer.
        detail: The expected and the received input.
        retry_s: Seconds to wait before a retry, where the service gave them.
    """

    def __init__(self, status: int, detail: str, retry_s: float | None = None) -> None:
        super().__init__(f"{detail} (HTTP {status})" if status else detail)
        self.status, self.detail, self.retry_s = status, detail, retry_s


class Client(Calls[Document]):
    """Blocking client. Every method raises ServiceError where the service refuses or cannot be reached."""

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

    def _send(self, call: Call) -> httpx.Response:
        try:
            return _checked(self._http.request(**call.arguments()))
        except httpx.HTTPError as error:
            raise _unreachable(self._url, error) from error

    def _load(self, call: Call, limit_bytes: int) -> tuple[bytes, httpx.Headers]:
        """Content of an answer, unpacked and not larger than a limit, and its headers."""
        content = bytearray()
        try:
            with self._http.stream(**call.arguments()) as response:
                if not response.is_success:
                    response.read()
                _checked(response)
                for chunk in response.iter_bytes():
                    content += chunk
                    _check_size(content, limit_bytes, call)
        except httpx.HTTPError as error:
            raise _unreachable(self._url, error) from error
        return bytes(content), response.headers

    def _json(self, call: Call) -> Document:
        answer = self._send(call)
        document: Document = answer.json()
        if answer.status_code != ACCEPTED:
            return document
        while document["status"] not in ENDED:
            time.sleep(POLL_S)
            document = self.get(path_of("jobs", document["id"]))
        return _made_by(document)

    def items(self, path: str, **query: Any) -> Iterator[Document]:
        """All items of a paged list, such as `items("/v1/evaluations", agent="my-agent")`."""
        after: str | None = None
        while True:
            page = self.get(path, **query, after=after)
            yield from page["items"]
            after = page["next"]
            if after is None:
                return

    def episodes(self, evaluation_id: str) -> Iterator[Document]:
        """Episodes of an evaluation, in the benchmark's order."""
        return self.items(path_of("evaluations", evaluation_id, "episodes"))

    def ensure_agent(self, name: str, description: str = "") -> Document:
        """The agent of that name; registers it where it is missing."""
        try:
            return self.get(path_of("agents", name))
        except ServiceError as error:
            if error.status != 404:
                raise
        return self.register_agent(name, description)

    def ensure_remote(self, agent: str, info: AgentInfo) -> int:
        """The version of an agent that declares `info`; registers and submits it where it is missing."""
        self.ensure_agent(agent)
        there = _versions_like(self.get(path_of("agents", agent, "submissions")), info)
        return there[-1] if there else int(self.submit_remote(agent, info)["version"])

    def wait(self, evaluation_id: str, timeout_s: float | None = None) -> Document:
        """Waits until an evaluation has ended.

        Raises:
            TimeoutError: The evaluation did not end in that time.
        """
        ends = time.monotonic() + timeout_s if timeout_s is not None else None
        while (evaluation := self.evaluation(evaluation_id))["status"] not in ENDED:
            if ends is not None and time.monotonic() > ends:
                raise TimeoutError(f"evaluation '{evaluation_id}' is still {evaluation['status']}")
            time.sleep(POLL_S)
        return evaluation

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

    def worker(self, agent: str, *, version: int | None = None, capacity: int = 1) -> WorkerSession:
        """A session of a policy worker for an agent."""
        return WorkerSession(self._url, self._token or "", agent, version=version, capacity=capacity)


class AsyncClient(Calls[Awaitable[Document]]):
    """`Client` for asyncio: the same methods, to be awaited."""

    def __init__(self, url: str, token: str | None = None, *, timeout_s: float = TIMEOUT_S) -> None:
        """See `Client`."""
        self._url, self._token = url, token
        self._http = httpx.AsyncClient(base_url=url, headers=_headers(token), timeout=timeout_s)

    async def close(self) -> None:
        """Closes the connections."""
        await self._http.aclose()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        await self.close()

    async def _send(self, call: Call) -> httpx.Response:
        try:
            return _checked(await self._http.request(**call.arguments()))
        except httpx.HTTPError as error:
            raise _unreachable(self._url, error) from error

    async def _load(self, call: Call, limit_bytes: int) -> tuple[bytes, httpx.Headers]:
        """See `Client._load`."""
        content = bytearray()
        try:
            async with self._http.stream(**call.arguments()) as response:
                if not response.is_success:
                    await response.aread()
                _checked(response)
                async for chunk in response.aiter_bytes():
                    content += chunk
                    _check_size(content, limit_bytes, call)
        except httpx.HTTPError as error:
            raise _unreachable(self._url, error) from error
        return bytes(content), response.headers

    async def _json(self, call: Call) -> Document:
        answer = await self._send(call)
        document: Document = answer.json()
        if answer.status_code != ACCEPTED:
            return document
        while document["status"] not in ENDED:
            await asyncio.sleep(POLL_S)
            document = await self.get(path_of("jobs", document["id"]))
        return _made_by(document)

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

    def episodes(self, evaluation_id: str) -> AsyncIterator[Document]:
        """See `Client.episodes`."""
        return self.items(path_of("evaluations", evaluation_id, "episodes"))

    async def ensure_agent(self, name: str, description: str = "") -> Document:
        """See `Client.ensure_agent`."""
        try:
            return await self.get(path_of("agents", name))
        except ServiceError as error:
            if error.status != 404:
                raise
        return await self.register_agent(name, description)

    async def ensure_remote(self, agent: str, info: AgentInfo) -> int:
        """See `Client.ensure_remote`."""
        await self.ensure_agent(agent)
        there = _versions_like(await self.get(path_of("agents", agent, "submissions")), info)
        return there[-1] if there else int((await self.submit_remote(agent, info))["version"])

    async def wait(self, evaluation_id: str, timeout_s: float | None = None) -> Document:
        """See `Client.wait`."""
        async with asyncio.timeout(timeout_s):
            while (evaluation := await self.evaluation(evaluation_id))["status"] not in ENDED:
                await asyncio.sleep(POLL_S)
        return evaluation

    async def download(self, evaluation_id: str, folder: Path) -> list[Path]:
        """See `Client.download`."""
        await asyncio.to_thread(folder.mkdir, parents=True, exist_ok=True)
        paths: list[Path] = []
        async for episode in self.episodes(evaluation_id):
            if episode["record_hash"]:
                download = Download(episode, folder)
                if download.path in paths:
                    raise InvalidInputError(f"the server lists '{download.path.name}' twice")
                for part, call, limit in download.parts:
                    for path, content in download.files(part, *await self._load(call, limit)):
                        await asyncio.to_thread(write_atomically, path, content)
                paths.append(download.path)
        return paths

    def worker(self, agent: str, *, version: int | None = None, capacity: int = 1) -> WorkerSession:
        """See `Client.worker`; the session blocks, so it belongs into a thread of its own."""
        return WorkerSession(self._url, self._token or "", agent, version=version, capacity=capacity)


def _made_by(job: Document) -> Document:
    """What an ended job gave."""
    if job["status"] == "done":
        answer: Document = job["answer"]
        return answer
    failure = job["failure"] or {"status": 409, "detail": f"job '{job['id']}' was cancelled"}
    raise ServiceError(failure["status"], failure["detail"])


def _headers(token: str | None) -> dict[str, str]:
    return {"authorization": f"Bearer {token}"} if token else {}


def _checked(response: httpx.Response) -> httpx.Response:
    if response.is_success:
        return response
    try:
        detail = str(response.json()["detail"])
    except (ValueError, KeyError, TypeError):
        detail = response.text[:200] or "no reason given"
    told = response.headers.get("retry-after", "")
    raise ServiceError(response.status_code, detail, float(told) if told.isdigit() else None)


def _unreachable(url: str, error: httpx.HTTPError) -> ServiceError:
    return ServiceError(0, f"no answer from {url}: {type(error).__name__}: {error}")


def _versions_like(listed: Document, info: AgentInfo) -> list[int]:
    """Versions among an agent's submissions that declare exactly this remote agent."""
    wanted = {**info.model_dump(mode="json"), "kind": "remote"}
    return [one["version"] for one in listed["items"] if all(one.get(key) == value for key, value in wanted.items())]


def _check_size(content: bytes | bytearray, limit_bytes: int, call: Call) -> None:
    if len(content) > limit_bytes:
        raise InvalidInputError(
            f"{call.path}: expected at most {limit_bytes // 1_000_000} MB, and the server sent more"
        )
