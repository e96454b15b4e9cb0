"""Metrics of the service: counts and durations, which Prometheus reads."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from importlib.metadata import version
from typing import Any, Final

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, Info, ProcessCollector
from starlette.types import Scope

STEP: Final = "/v1/leases/{lease}/step"
REQUEST_S: Final = (0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 30.0, 60.0)
STEP_S: Final = (0.0001, 0.0002, 0.0003, 0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.5, 1.0)
METHODS: Final = frozenset({"GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"})
REFUSED: Final = {
    401: "wrong token",
    403: "not permitted",
    408: "too slow",
    413: "body too large",
    429: "quota or rate",
    503: "busy",
}


class Metrics:
    """Counts and durations since the start of the process.

    Attributes:
        registry: All metrics.
        requests: Requests by route, method and status.
        seconds: Duration of requests by route; a stream lasts until its end.
        steps: Duration of the steps of policy workers, from the action to the next observation.
        episodes: Changes of episodes by their new status; an episode that is queued again is counted each time.
        refused: Refused requests and closed connections by reason.
        connections: Open connections.
    """

    def __init__(self) -> None:
        self.registry = registry = CollectorRegistry()
        ProcessCollector(registry=registry)
        Info("dohyo_build", "Versions.", registry=registry).info(
            {"version": version("dohyo"), "sumo": version("libsumo"), "python": platform.python_version()}
        )
        self.requests = Counter("dohyo_requests", "Requests.", ["route", "method", "status"], registry=registry)
        self.seconds = Histogram(
            "dohyo_request_seconds", "Duration of requests.", ["route"], buckets=REQUEST_S, registry=registry
        )
        self.steps = Histogram(
            "dohyo_wire_step_seconds", "Duration of a policy worker's steps.", buckets=STEP_S, registry=registry
        )
        self.episodes = Counter("dohyo_episode_changes", "Episodes by new status.", ["status"], registry=registry)
        self.refused = Counter("dohyo_refused", "Refused requests, closed connections.", ["reason"], registry=registry)
        self.connections = Gauge("dohyo_connections", "Open connections.", registry=registry)

    def note_request(self, scope: Scope, status: int, took_s: float) -> None:
        """Counts an answered request."""
        if status in REFUSED:
            self.refused.labels(REFUSED[status]).inc()
        # Paths and methods that a client invents would make a series each.
        stepped = scope["path"].startswith("/v1/leases/") and scope["path"].endswith("/step")
        route = STEP if stepped else scope["state"].get("route", "none")
        method = scope["method"] if scope["method"] in METHODS else "other"
        if route == STEP and status == 200:
            self.steps.observe(took_s)
            return
        self.requests.labels(route, method, status).inc()
        self.seconds.labels(route).observe(took_s)

    def note_event(self, topic: str, message: Mapping[str, Any]) -> None:
        """Counts a change of an episode, as listeners of its evaluation read it."""
        if "episode" in message and "status" in message:
            self.episodes.labels(message["status"]).inc()
