"""The result of one agent on one benchmark of the freeway: facts by day or seed, with their means and comparisons.

Every unit (a day, or the seed of a morning) gives one value per metric, for the agent and for a reference on the same
unit. Means, intervals and paired differences are computed from these alone; the file has them for readers.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

from dohyo.evaluation.freeway.benchmark import FreewayBenchmark
from dohyo.evaluation.statistics import Comparison, Estimate, mean_estimate, paired
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import write_atomically
from dohyo.sumo_networks.scenario import content_hash

RESULT = "result.json"
Units = Mapping[str, Mapping[str, float]]
"""Values by unit and metric."""


@dataclass(frozen=True, slots=True)
class Metric:
    """A quantity that is measured on every unit.

    Attributes:
        key: Name in the facts.
        title: Name for people.
        unit: Unit of the values as they are shown.
        better: Whether lower or higher values are better; None: neither.
        root: Whether the values are squares; their means and intervals are then shown as roots.
    """

    key: str
    title: str
    unit: str
    better: Literal["lower", "higher"] | None
    root: bool = False


@dataclass(frozen=True, slots=True)
class AgentFacts:
    """The agent that was evaluated.

    Attributes:
        name: Name as given by the user.
        settings: Settings as given by the user.
        sha256: Hash of its learned weights, or of its sources.
    """

    name: str
    settings: Mapping[str, Any]
    sha256: str


@dataclass(frozen=True)
class FreewayResult:
    """One agent on one benchmark of the freeway.

    Attributes:
        benchmark: Benchmark of the evaluation.
        agent: Agent that was evaluated.
        reference: Name of the agent that it is compared with.
        metrics: Metrics that were measured; the first one is the headline.
        units: Values of the agent, by unit and metric.
        reference_units: Values of the reference, likewise.
        versions: Versions of dohyo and SUMO, and the hash of the network.
        timing: Wall-clock facts, which are in no hash.
    """

    benchmark: FreewayBenchmark
    agent: AgentFacts
    reference: str
    metrics: Sequence[Metric]
    units: Units
    reference_units: Units
    versions: Mapping[str, str]
    timing: Mapping[str, float] = field(default_factory=dict)

    @cached_property
    def estimates(self) -> dict[str, Estimate]:
        """Estimates of the agent, by metric."""
        return {metric.key: self._estimate(metric, self.units) for metric in self.metrics}

    @cached_property
    def reference_estimates(self) -> dict[str, Estimate]:
        """Estimates of the reference, by metric."""
        return {metric.key: self._estimate(metric, self.reference_units) for metric in self.metrics}

    @cached_property
    def comparisons(self) -> dict[str, Comparison]:
        """Agent minus reference on the units of both, by metric; a metric with `root` compares squares."""
        both = [name for name in self.units if name in self.reference_units]
        sides = (self.units, self.reference_units)
        return {
            metric.key: paired(*([one[name][metric.key] for name in both] for one in sides))
            for metric in self.metrics
            if both
        }

    @property
    def record_hash(self) -> str:
        """Hex sha256 of everything except timing: the same agent, benchmark and versions give the same hash."""
        return content_hash(self._facts())

    def percent(self, key: str) -> Estimate | None:
        """Difference from the reference in percent of the reference's mean; None without a reference."""
        base = self.reference_estimates[key].mean
        if not base or key not in self.comparisons or self.agent.name == self.reference:
            return None
        found = self.comparisons[key].difference
        mean, low, high = (None if one is None else 100 * one / base for one in (found.mean, found.low, found.high))
        return Estimate(mean, low, high, found.n)

    def document(self) -> dict[str, Any]:
        """The whole result as plain JSON."""
        scores = {
            metric.key: {
                "title": metric.title,
                "unit": metric.unit,
                "better": metric.better,
                "agent": dataclasses.asdict(self.estimates[metric.key]),
                "reference": dataclasses.asdict(self.reference_estimates[metric.key]),
                "difference": _compared(self.comparisons.get(metric.key)),
            }
            for metric in self.metrics
        }
        return self._facts() | {"record_hash": self.record_hash, "scores": scores, "timing": dict(self.timing)}

    def _facts(self) -> dict[str, Any]:
        return {
            "benchmark": self.benchmark.model_dump(mode="json"),
            "benchmark_sha256": self.benchmark.sha256,
            "agent": dataclasses.asdict(self.agent),
            "reference": self.reference,
            "versions": dict(self.versions),
            "units": {name: dict(values) for name, values in self.units.items()},
            "reference_units": {name: dict(values) for name, values in self.reference_units.items()},
        }

    def _estimate(self, metric: Metric, units: Units) -> Estimate:
        found = mean_estimate([values[metric.key] for values in units.values()])
        return root_estimate(found) if metric.root else found


def root_estimate(squares: Estimate) -> Estimate:
    """Estimate of a root from that of squares: the root is monotonic, so the ends of the interval have roots too."""
    mean, low, high = (
        None if one is None else math.sqrt(max(one, 0.0)) for one in (squares.mean, squares.low, squares.high)
    )
    return Estimate(mean, low, high, squares.n)


def _compared(comparison: Comparison | None) -> dict[str, Any] | None:
    return None if comparison is None else dataclasses.asdict(comparison)


def claim(out: Path, benchmark: FreewayBenchmark, agent: AgentFacts) -> None:
    """Refuses a folder with another evaluation, before anything is driven.

    Raises:
        InvalidInputError: The folder has the result of another evaluation.
    """
    path = out / RESULT
    if not path.exists():
        if (out / "evaluation.json").exists():
            raise InvalidInputError(f"'{out}' holds an evaluation of a driving agent: expected another --out")
        return
    try:
        before = json.loads(path.read_text(encoding="utf-8"))
        theirs = (before["benchmark_sha256"], before["agent"]["name"], before["agent"]["settings"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InvalidInputError(f"'{path}': expected a result of dohyo evaluate, and it cannot be read") from error
    ours = (benchmark.sha256, agent.name, json.loads(json.dumps(dict(agent.settings))))
    if theirs != ours:
        raise InvalidInputError(
            f"'{out}' holds another evaluation: expected {ours[1]} on {benchmark.name} {ours[0][:12]}, got "
            f"{theirs[1]} on {theirs[0][:12]}; choose another --out"
        )


def write_result(out: Path, result: FreewayResult) -> Path:
    """Writes the result's file.

    Raises:
        InvalidInputError: It cannot be written.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
        write_atomically(out / RESULT, (json.dumps(result.document(), indent=1, allow_nan=False) + "\n").encode())
    except OSError as error:
        raise InvalidInputError(f"cannot write '{out / RESULT}': {error.strerror}") from error
    return out / RESULT


@dataclass(frozen=True, slots=True)
class Row:
    """A metric with the estimates of agent and reference.

    Attributes:
        metric: Metric of the row.
        ours: Estimate of the agent.
        theirs: Estimate of the reference.
        percent: Paired difference in percent of the reference's mean; None if there is none, or if it would only repeat
            that of the squares.
        verdict: Verdict on that difference; "" without one.
    """

    metric: Metric
    ours: Estimate
    theirs: Estimate
    percent: Estimate | None
    verdict: str


def rows(result: FreewayResult) -> Iterator[Row]:
    """One row for each metric."""
    for metric in result.metrics:
        percent = None if metric.root else result.percent(metric.key)
        verdict = result.comparisons[metric.key].verdict if percent is not None else ""
        yield Row(metric, result.estimates[metric.key], result.reference_estimates[metric.key], percent, verdict)
