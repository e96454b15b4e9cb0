"""Calls: what the service can be asked for in one request; Client and AsyncClient send them, each in its way."""

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
    """A request to be sent; of query and body, what is None is left out."""

    method: str
    path: str
    query: Mapping[str, Any] | None = None
    body: Mapping[str, Any] | None = None
    files: Mapping[str, Any] | None = None

    def arguments(self) -> dict[str, Any]:
        """For httpx."""
        out: dict[str, Any] = {"method": self.method, "url": self.path, "params": _given(self.query or {})}
        if self.files is not None:
            out |= {"files": self.files}
        elif self.body is not None:
            out |= {"json": _given(self.body)}
        return out


class Calls(ABC, Generic[Answer]):
    """The calls; every one raises ServiceError where the service refuses or is not there.

    `Answer` is a JSON document of the service's, or the promise of one.
    """

    @abstractmethod
    def _json(self, call: Call) -> Answer:
        """Sends a request."""

    def get(self, path: str, **query: Any) -> Answer:
        """Any JSON document of the interface, such as `get("/v1/networks")`."""
        return self._json(Call("GET", path, query))

    def register_agent(self, name: str, description: str = "") -> Answer:
        """Makes an agent of the token's owner."""
        return self._json(Call("POST", "/v1/agents", body={"name": name, "description": description}))

    def submit_builtin(self, agent: str, entry: str, settings: Mapping[str, Any] | None = None) -> Answer:
        """Submits an agent that comes with the service."""
        return self._submit(agent, {"kind": "builtin", "entry": entry, "settings": dict(settings or {})})

    def submit_remote(self, agent: str, info: AgentInfo) -> Answer:
        """Declares an agent that drives through workers; `info` is what its records will say."""
        return self._submit(agent, {"kind": "remote", **info.model_dump(mode="json")})

    def submit_onnx(self, agent: str, policy: Path, spec: Mapping[str, Any]) -> Answer:
        """Submits an ONNX file; `spec` says its track, sensors and control.

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
        slow_policy: Literal["wait", "realtime"] = "wait",
        act_deadline_s: float | None = None,
    ) -> Answer:
        """Queues an evaluation; by default of the latest version, with the benchmark's seeds."""
        body = {
            "agent": agent,
            "benchmark": benchmark,
            "version": version,
            "seeds": list(seeds) if seeds is not None else None,
            "slow_policy": slow_policy,
            "act_deadline_s": act_deadline_s,
        }
        return self._json(Call("POST", "/v1/evaluations", body=body))

    def evaluation(self, evaluation_id: str) -> Answer:
        """An evaluation as it stands."""
        return self.get(path_of("evaluations", evaluation_id))

    def metrics(self, evaluation_id: str) -> Answer:
        """Its scores with intervals, of the episodes finished so far."""
        return self.get(path_of("evaluations", evaluation_id, "metrics"))

    def manifest(self, evaluation_id: str) -> Answer:
        """What it evaluates, as a result folder of `dohyo evaluate` says it."""
        return self.get(path_of("evaluations", evaluation_id, "manifest"))

    def cancel(self, evaluation_id: str) -> Answer:
        """Ends an evaluation; its finished episodes stay."""
        return self._json(Call("POST", path_of("evaluations", evaluation_id, "cancel")))

    def resume(self, evaluation_id: str) -> Answer:
        """Drives again what was lost or cancelled."""
        return self._json(Call("POST", path_of("evaluations", evaluation_id, "resume")))

    def record(self, episode_id: str) -> Answer:
        """The facts of an episode."""
        return self.get(path_of("episodes", episode_id, "record"))

    def begin_morning(self, agent: str, *, seed: int = 0, minutes: float | None = None) -> Answer:
        """Lets an agent's policy worker be the planner of a morning on the freeway."""
        body = {"agent": agent, "seed": seed, "minutes": minutes}
        return self._json(Call("POST", "/v1/freeway/mornings", body=body))

    def morning(self, morning_id: str) -> Answer:
        """A morning as it stands, with what became of all traffic once it is over."""
        return self.get(path_of("freeway", "mornings", morning_id))

    def leaderboard(self, benchmark: str, *, version: str | None = None, track: str | None = None) -> Answer:
        """Who drives best."""
        return self.get("/v1/leaderboard", benchmark=benchmark, version=version, track=track)

    def comparison(self, evaluation_ids: Sequence[str]) -> Answer:
        """Evaluations of one benchmark version side by side."""
        return self.get("/v1/comparison", evaluation=list(evaluation_ids))

    def _submit(self, agent: str, body: Mapping[str, Any]) -> Answer:
        return self._json(Call("POST", path_of("agents", agent, "submissions"), body=body))


def path_of(*parts: str) -> str:
    """A path of the interface, its parts quoted."""
    return "/v1/" + "/".join(quote(part, safe="") for part in parts)


def _given(values: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in values.items() if value is not None}
