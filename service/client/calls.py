"""Calls: requests as data, before they are sent."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final
from urllib.parse import quote

from dohyo.evaluation.records.record import AgentInfo

Document = dict[str, Any]

ENDED: Final = ("done", "failed", "cancelled")
"""States of evaluations and jobs that do not change without a new order."""


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


def path_of(*parts: str) -> str:
    """A path of the interface with quoted parts."""
    return "/v1/" + "/".join(quote(part, safe="") for part in parts)


def headers_of(token: str | None) -> dict[str, str]:
    """Headers of every request."""
    return {"authorization": f"Bearer {token}"} if token else {}


def remote_of(info: AgentInfo) -> Document:
    """Declaration of an agent that drives through workers."""
    return {**info.model_dump(mode="json"), "kind": "remote"}


def versions_like(listed: Document, info: AgentInfo) -> list[int]:
    """Versions among an agent's submissions that declare exactly this remote agent."""
    wanted = remote_of(info)
    return [one["version"] for one in listed["items"] if all(one.get(key) == value for key, value in wanted.items())]


def _given(values: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in values.items() if value is not None}
