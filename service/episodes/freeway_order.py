"""FreewayOrder: one morning on the freeway whose planner is a policy worker."""

from __future__ import annotations

from typing import Any, Literal

from dohyo.evaluation.freeway.benchmark import TrafficBenchmark
from dohyo.sumo_networks.config import Config

DECIDES_EVERY_S = 60.0


class FreewayOrder(Config):
    """What the server asks of the process, and what the worker is told.

    Attributes:
        benchmark: Which mornings.
        seed: Of the morning.
        agent: Whose workers plan.
        act_deadline_s: Wall-clock time for one plan.
        slow_policy: The simulation waits.
        decision_s: Simulated time between two plans.
    """

    benchmark: TrafficBenchmark
    seed: int
    agent: str
    act_deadline_s: float
    slow_policy: Literal["wait"] = "wait"
    decision_s: float = DECIDES_EVERY_S

    def facts(self) -> dict[str, Any]:
        """What is known of it from the beginning."""
        return {
            "agent": self.agent,
            "benchmark": self.benchmark.name,
            "version": self.benchmark.sha256,
            "seed": self.seed,
        }

    def told(self, version: int) -> dict[str, Any]:
        """What a worker is told of it with its lease."""
        spec = {
            "name": self.agent,
            "version": version,
            "track": "privileged",
            "sensors": ["speeds"],
            "control": "target_speeds",
            "settings": {},
        }
        return {"dt_s": self.decision_s, "missions": [], "seed": self.seed, "spec": spec}
