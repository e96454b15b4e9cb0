"""FreewayOrder: one freeway morning with a policy worker as planner."""

from __future__ import annotations

from typing import Any, Literal

from dohyo.evaluation.freeway.benchmark import TrafficBenchmark
from dohyo.sumo_networks.config import Config

DECIDES_EVERY_S = 60.0


class FreewayOrder(Config):
    """The server's order to the process, and the facts for the worker.

    Attributes:
        benchmark: Name of the benchmark.
        seed: Seed of the morning.
        agent: Agent whose workers plan.
        act_deadline_s: Wall-clock time for one plan.
        slow_policy: "wait": the simulation waits for the worker.
        decision_s: Simulated time between two plans.
    """

    benchmark: TrafficBenchmark
    seed: int
    agent: str
    act_deadline_s: float
    slow_policy: Literal["wait"] = "wait"
    decision_s: float = DECIDES_EVERY_S

    def facts(self) -> dict[str, Any]:
        """State of the morning before its start."""
        return {
            "agent": self.agent,
            "benchmark": self.benchmark.name,
            "version": self.benchmark.sha256,
            "seed": self.seed,
        }

    def told(self, version: int) -> dict[str, Any]:
        """Facts for the worker at the start of its lease."""
        spec = {
            "name": self.agent,
            "version": version,
            "track": "privileged",
            "sensors": ["speeds"],
            "control": "target_speeds",
            "settings": {},
        }
        return {"dt_s": self.decision_s, "missions": [], "seed": self.seed, "spec": spec}
