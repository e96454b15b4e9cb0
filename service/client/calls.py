"""Calls: the requests of the service's clients, shared by Client and AsyncClient."""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, Literal, TypeVar
from urllib.parse import quote

from dohyo.evaluation.records.record import AgentInfo
from dohyo.sumo_networks.errors import InvalidInputError

Document = dict[str, Any]
Answer = TypeVar("Answer")


@dataclass(frozen=True, slots=True)
class Call:
    """A request to send; entries of query and body that are None are left out."""

    method: str
    path: str
    query: Mapping[str, Any] | None = None
    body: Mapping[str, Any] | None = None
    files: Mapping[str, Any] | None = None

    def arguments(self) -> dict[str, Any]:
        """Arguments of the request for httpx."""
        out: dict[str, Any] = {"method": self.method, "url": self.path, "params": _given(self.query or {})}
        if self.method == "POST":
            out |= {"headers": {"prefer": "wait=30"}}  # so that most jobs end within their order
        if self.files is not None:
            out |= {"files": self.files}
        elif self.body is not None:
            out |= {"json": _given(self.body)}
        return out


class Calls(ABC, Generic[Answer]):
    """The calls; each raises ServiceError where the service refuses or cannot be reached.

    `Answer` is a JSON document, or an awaitable of one.
    """

    @abstractmethod
    def _json(self, call: Call) -> Answer:
        """Sends a request."""

    def get(self, path: str, **query: Any) -> Answer:
        """Any JSON document of the interface, such as `get("/v1/networks")`."""
        return self._json(Call("GET", path, query))

    def register_agent(self, name: str, description: str = "") -> Answer:
        """Registers an agent of the token's owner."""
        return self._json(Call("POST", "/v1/agents", body={"name": name, "description": description}))

    def submit_builtin(self, agent: str, entry: str, settings: Mapping[str, Any] | None = None) -> Answer:
        """Submits a built-in agent of the service."""
        return self._submit(agent, {"kind": "builtin", "entry": entry, "settings": dict(settings or {})})

    def submit_remote(self, agent: str, info: AgentInfo) -> Answer:
        """Declares an agent that drives through workers; `info` appears in its records."""
        return self._submit(agent, {**info.model_dump(mode="json"), "kind": "remote"})

    def submit_onnx(self, agent: str, policy: Path, spec: Mapping[str, Any]) -> Answer:
        """Submits an ONNX file; `spec` gives its track, sensors and control.

        Raises:
            InvalidInputError: The file cannot be read.
        """
        try:
            content = policy.read_bytes()
        except OSError as error:
            raise InvalidInputError(f"policy '{policy}' cannot be read: {error.strerror}") from error
        files = {"spec": (None, json.dumps(dict(spec)), "application/json"), "file": (policy.name, content)}
        return self._json(Call("POST", path_of("agents", agent, "submissions", "onnx"), files=files))

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
    ) -> Answer:
        """Queues an evaluation, by default a practice run of the latest version with the benchmark's seeds.

        A ranked run may enter a board, counts against a quota, and takes all conditions from its ranking: that of
        `ranking`, a phase of a challenge, or the benchmark's open one.
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
        }
        return self._json(Call("POST", "/v1/evaluations", body=body))

    def evaluation(self, evaluation_id: str) -> Answer:
        """State of an evaluation."""
        return self.get(path_of("evaluations", evaluation_id))

    def metrics(self, evaluation_id: str) -> Answer:
        """Scores of an evaluation with intervals, over the finished episodes."""
        return self.get(path_of("evaluations", evaluation_id, "metrics"))

    def manifest(self, evaluation_id: str) -> Answer:
        """Manifest of an evaluation, as in a result folder of `dohyo evaluate`."""
        return self.get(path_of("evaluations", evaluation_id, "manifest"))

    def cancel(self, evaluation_id: str) -> Answer:
        """Cancels an evaluation; finished episodes are kept."""
        return self._json(Call("POST", path_of("evaluations", evaluation_id, "cancel")))

    def resume(self, evaluation_id: str) -> Answer:
        """Queues lost and cancelled episodes again."""
        return self._json(Call("POST", path_of("evaluations", evaluation_id, "resume")))

    def record(self, episode_id: str) -> Answer:
        """Record of an episode."""
        return self.get(path_of("episodes", episode_id, "record"))

    def leaderboard(
        self,
        benchmark: str | None = None,
        *,
        version: str | None = None,
        track: str | None = None,
        ranking: str | None = None,
        limit: int = 100,
        after: str | None = None,
    ) -> Answer:
        """A page of a benchmark's open leaderboard, or with `ranking` of a challenge's phase."""
        page = {"limit": limit, "after": after}
        return self.get("/v1/leaderboard", benchmark=benchmark, version=version, track=track, ranking=ranking, **page)

    def comparison(self, evaluation_ids: Sequence[str]) -> Answer:
        """Evaluations of one benchmark version side by side."""
        return self.get("/v1/comparison", evaluation=list(evaluation_ids))

    def _submit(self, agent: str, body: Mapping[str, Any]) -> Answer:
        return self._json(Call("POST", path_of("agents", agent, "submissions"), body=body))


def path_of(*parts: str) -> str:
    """A path of the interface with quoted parts."""
    return "/v1/" + "/".join(quote(part, safe="") for part in parts)


def _given(values: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in values.items() if value is not None}
