"""Ablations and baselines on a benchmark, paired.

    python -m dohyo.agents.mcts.study --benchmark val14 --out out/mbappe

Every arm drives the same scenarios and seeds, the autopilot first. The same command resumes, drive by drive. Excerpts
are measured by the closed-loop score, whole routes by what the leaderboard and NoCrash count. Results go to
OUT/study.json, and with --results into the tables of RESULTS.md.

A benchmark of excerpts is split by the number of a mission: the planner is developed on the odd ones (`--part look`),
and the tables show the even ones (`--part held-out`). `--per-type` limits the scenarios of each type, by the hash of
their names.
"""

from __future__ import annotations

import argparse
import dataclasses
import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, get_args

from dohyo.agents.mcts.losses import CAUSES, losses
from dohyo.agents.mcts.tables import EXCERPTS, ROUTES, section, shown, tables
from dohyo.agents.registry import resolve
from dohyo.agents.results_page import PAGE, write_section
from dohyo.evaluation.benchmarks.benchmark import Benchmark, load_benchmark
from dohyo.evaluation.records.record import EgoRecord
from dohyo.evaluation.records.specifications import COLLISIONS, Status
from dohyo.evaluation.records.store import read_trajectory
from dohyo.evaluation.running.executors import ProcessPool
from dohyo.evaluation.running.run import Result, run_benchmark
from dohyo.evaluation.scores.nuplan.score import ClosedLoop, closed_loop
from dohyo.evaluation.statistics import Comparison, Estimate, mean_estimate, paired, share_estimate
from dohyo.evaluation.summary import score_drive
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import write_atomically
from dohyo.sumo_networks.networks.catalog import load_network

REFERENCE = "autopilot"
SHARES = ("collisions", "off_road", "nocrash_success", "perfect", "hits", "out_of_time")
"""Metrics that are 0 or 100 in every drive."""
METRICS = tuple(dict.fromkeys(("score", *ROUTES, *EXCERPTS)))
Part = Literal["all", "look", "held-out"]
Key = tuple[str, int, str]
Drives = dict[Key, dict[str, float]]


@dataclass(frozen=True, slots=True)
class Arm:
    """One agent with its settings.

    Attributes:
        agent: Registered name.
        settings: Of its constructor.
        thesis: The thesis's score, % (Val14 of nuPlan, not comparable in height); None without one.
    """

    agent: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    thesis: float | None = None


def _mbappe(thesis: float | None = None, **settings: Any) -> Arm:
    return Arm("mbappe", MappingProxyType(settings), thesis)


ARMS: Mapping[str, Arm] = MappingProxyType(
    {
        "autopilot": Arm("autopilot"),
        "mbappe": _mbappe(86),
        "prior-none": _mbappe(26, prior="none"),
        "prior-learned": _mbappe(65, prior="learned"),
        "prior-crafted": _mbappe(82, prior="crafted"),
        "constraints-none": _mbappe(79, constraints="none"),
        "constraints-tree": _mbappe(82, constraints="tree"),
        "constraints-node": _mbappe(82, constraints="node"),
        "predictor-constant_velocity": _mbappe(predictor="constant_velocity"),
        "predictor-idm": _mbappe(predictor="idm"),
        "alone-constant_velocity": Arm("predictor-only", MappingProxyType({"predictor": "constant_velocity"})),
        "alone-idm": Arm("predictor-only", MappingProxyType({"predictor": "idm"})),
        "alone-learned": Arm("predictor-only", MappingProxyType({"predictor": "learned"}), 47),
        "hold-0.1s": _mbappe(hold_s=0.1),
        "thesis-crafted": _mbappe(crafted="limit", first_play="zero", choice="visits", reuse=False),
        "thesis-wheel": _mbappe(steering="wheel"),
        "learned-everywhere": _mbappe(learned_prior_s=8.0),
        "no-reuse": _mbappe(reuse=False),
        "choice-q": _mbappe(choice="q"),
        "choice-visits": _mbappe(choice="visits"),
        "value-network": _mbappe(value="network"),
        "random-shooting": Arm("random-shooting"),
        "idm": Arm("idm", thesis=76),
        "pdm-closed": Arm("pdm-closed"),
        "pdm-published": Arm("pdm-closed", MappingProxyType({"variant": "published"}), 92),
    }
)
"""The base is `mbappe`: both priors, both constraints, the learned predictor, 1 s hold."""

CLAIMS: tuple[tuple[str, str, str], ...] = (
    ("prior-learned", "prior-none", "score"),
    ("prior-crafted", "prior-learned", "score"),
    ("mbappe", "prior-crafted", "score"),
    ("mbappe", "prior-none", "score"),
    ("prior-learned", "prior-none", "collisions"),
    ("constraints-tree", "constraints-none", "score"),
    ("constraints-node", "constraints-none", "score"),
    ("mbappe", "constraints-none", "score"),
    ("mbappe", "constraints-tree", "score"),
    ("mbappe", "constraints-node", "score"),
    ("predictor-idm", "predictor-constant_velocity", "score"),
    ("mbappe", "predictor-idm", "score"),
    ("mbappe", "predictor-constant_velocity", "score"),
    ("mbappe", "alone-learned", "score"),
    ("predictor-idm", "alone-idm", "score"),
    ("predictor-constant_velocity", "alone-constant_velocity", "score"),
    ("mbappe", "hold-0.1s", "score"),
    ("mbappe", "random-shooting", "score"),
    ("mbappe", "idm", "score"),
    ("mbappe", "choice-q", "score"),
    ("mbappe", "choice-visits", "score"),
    ("mbappe", "thesis-crafted", "score"),
    ("mbappe", "thesis-wheel", "score"),
    ("mbappe", "no-reuse", "score"),
    ("learned-everywhere", "mbappe", "score"),
    ("value-network", "mbappe", "score"),
    ("mbappe", "autopilot", "score"),
    ("pdm-closed", "idm", "score"),
    ("pdm-closed", "mbappe", "score"),
    ("pdm-closed", "pdm-published", "score"),
)
"""Claims on excerpts: (arm with the higher metric, arm with the lower one, metric)."""

ROUTE_CLAIMS: tuple[tuple[str, str, str], ...] = (
    ("mbappe", "autopilot", "nocrash_success"),
    ("mbappe", "autopilot", "driving_score"),
    ("pdm-closed", "autopilot", "nocrash_success"),
    ("pdm-closed", "autopilot", "driving_score"),
    ("mbappe", "pdm-closed", "driving_score"),
)
"""Claims on whole routes."""


def part_of(benchmark: Benchmark, part: Part, per_type: int | None = None) -> Benchmark:
    """One half of a benchmark's missions: "look" has the odd ones of every set, "held-out" the even ones.

    Args:
        benchmark: The whole benchmark.
        part: Which half, or both.
        per_type: Upper bound of scenarios per type: those whose names have the smallest hashes.

    Raises:
        InvalidInputError: The benchmark has no numbered missions, which only excerpts have.
    """
    if part == "all" and per_type is None:
        return benchmark
    if not benchmark.excerpts:
        raise InvalidInputError(f"benchmark '{benchmark.name}': expected a benchmark of excerpts for part '{part}'")
    parities = {"all": (0, 1), "look": (1,), "held-out": (0,)}[part]
    types: dict[str, list[str]] = {}
    for cell in benchmark.cells:
        for one in benchmark.missions[cell.missions]:
            if int(one.name.lstrip("m")) % 2 in parities:
                types.setdefault(cell.name.partition(".")[0], []).append(f"{cell.name}.{one.name}")
    kept = {name for names in types.values() for name in sorted(names, key=_hash)[:per_type]}
    missions = {
        cell.missions: some
        for cell in benchmark.cells
        if (some := tuple(m for m in benchmark.missions[cell.missions] if f"{cell.name}.{m.name}" in kept))
    }
    cells = tuple(cell for cell in benchmark.cells if cell.missions in missions)
    fields = {name: getattr(benchmark, name) for name in Benchmark.model_fields}
    return Benchmark(**fields | {"name": f"{benchmark.name}-{part}", "cells": cells, "missions": missions})


def cells_of(benchmark: Benchmark, prefix: str) -> Benchmark:
    """Cells of a benchmark whose names have a prefix.

    Raises:
        InvalidInputError: There is no such cell.
    """
    cells = tuple(cell for cell in benchmark.cells if cell.name.startswith(prefix))
    if not cells:
        names = ", ".join(cell.name for cell in benchmark.cells)
        raise InvalidInputError(f"benchmark '{benchmark.name}': expected a prefix of {names}, got '{prefix}'")
    missions = {cell.missions: benchmark.missions[cell.missions] for cell in cells}
    fields = {name: getattr(benchmark, name) for name in Benchmark.model_fields}
    return Benchmark(**fields | {"name": f"{benchmark.name}-{prefix}", "cells": cells, "missions": missions})


def _hash(name: str) -> bytes:
    return hashlib.sha256(name.encode()).digest()


def measure(result: Result) -> Drives:
    """Metrics of every drive that was not lost: of excerpts, if the scenario has a reference, else of routes.

    Args:
        result: Of one arm.
    """
    out: Drives = {}
    for record, path in zip(result.records, result.paths, strict=True):
        if record.lost:
            continue
        scenario = record.scenario
        metres = scenario.reference_m
        trajectory = None if metres is None else read_trajectory(path)
        for index, ego in enumerate(record.egos):
            key = (scenario.name, scenario.seed, ego.name)
            if trajectory is None or metres is None:
                out[key] = _of_route(ego)
            else:
                terms = closed_loop(record, trajectory, load_network(scenario.network), metres, index)
                out[key] = _of_excerpt(terms, ego)
    return out


def _of_excerpt(terms: ClosedLoop, ego: EgoRecord) -> dict[str, float]:
    return {
        "score": terms.score,
        "collisions": 100.0 * (terms.no_collision < 1.0),
        "off_road": 100.0 * (terms.drivable_area < 1.0),
        "progress": 100.0 * terms.progress,
        **{f"lost_{cause}": points for cause, points in losses(terms, ego).items()},
    }


def _of_route(ego: EgoRecord) -> dict[str, float]:
    scores, hits = score_drive(ego), [one for one in ego.infractions if one.kind in COLLISIONS]
    return {
        **{name: scores[name] for name in ("nocrash_success", "driving_score", "route_completion")},
        "perfect": 100.0 * (ego.status is Status.PERFECT),
        "hits": 100.0 * bool(hits),
        "collisions": 100.0 * any(one.at_fault for one in hits),
        "out_of_time": 100.0 * (ego.status is Status.TIMED_OUT),
    }


def estimates(drives: Drives) -> dict[str, Estimate]:
    """Mean of every metric over drives, with its interval."""
    measured = [metric for metric in METRICS if all(metric in drive for drive in drives.values())]
    found = {metric: [drive[metric] for drive in drives.values()] for metric in measured}
    return {
        metric: share_estimate([value > 0.0 for value in values]) if metric in SHARES else mean_estimate(values)
        for metric, values in found.items()
    }


def lost(drives: Drives) -> dict[str, tuple[float, int]]:
    """Loss of the mean score by each cause: points, and number of drives."""
    out = {}
    for cause in CAUSES:
        points = [drive[f"lost_{cause}"] for drive in drives.values() if drive.get(f"lost_{cause}", 0.0) > 0.0]
        if points:
            out[cause] = (sum(points) / len(drives), len(points))
    return out


def verdict(above: Drives, below: Drives, metric: str) -> tuple[str, Comparison | None]:
    """Verdict on a claim: reproduced, not resolved, or contradicted; on the drives of both arms."""
    keys = sorted(above.keys() & below.keys())
    if not keys:
        return "no drives in common", None
    compared = paired([above[key][metric] for key in keys], [below[key][metric] for key in keys])
    return {">": "reproduced", "=": "not resolved", "<": "contradicted"}[compared.verdict], compared


def run(
    benchmark: str,
    arms: Sequence[str],
    seeds: Sequence[int] | None,
    out: Path,
    workers: int,
    part: Part = "all",
    per_type: int | None = None,
    cells: str = "",
) -> dict[str, Any]:
    """Drives the arms, and writes OUT/study.json after each arm.

    Raises:
        InvalidInputError: An arm is unknown, or the benchmark, its part or OUT cannot be used.
    """
    unknown = sorted(set(arms) - set(ARMS))
    if unknown:
        raise InvalidInputError(f"expected arms of {', '.join(ARMS)}, got {', '.join(unknown)}")
    driven = part_of(load_benchmark(benchmark), part, per_type)
    driven = cells_of(driven, cells) if cells else driven
    drives: dict[str, Drives] = {}
    document: dict[str, Any] = {}
    for name in [REFERENCE, *(arm for arm in arms if arm != REFERENCE)]:
        arm = ARMS[name]
        result = run_benchmark(
            driven, resolve(arm.agent), settings=dict(arm.settings), seeds=seeds, out=out / name,
            executor=ProcessPool(workers),
        )  # fmt: skip
        drives[name] = measure(result)
        first, estimate = next(iter(estimates(drives[name]).items()))
        print(f"{name}: {first} {shown(estimate)}", flush=True)
        document = as_document(benchmark, drives, part, per_type, cells)
        write_atomically(out / "study.json", json.dumps(document, indent=1).encode())
    return document


def as_document(
    benchmark: str, drives: Mapping[str, Drives], part: Part = "all", per_type: int | None = None, cells: str = ""
) -> dict[str, Any]:
    """The study as plain JSON."""
    arms = {
        name: {
            "agent": ARMS[name].agent,
            "settings": dict(ARMS[name].settings),
            "thesis": ARMS[name].thesis,
            "metrics": {metric: dataclasses.asdict(value) for metric, value in estimates(found).items()},
            "lost": lost(found),
        }
        for name, found in drives.items()
    }
    claims = []
    for above, below, metric in CLAIMS if benchmark.startswith("val14") else ROUTE_CLAIMS:
        if above in drives and below in drives:
            word, compared = verdict(drives[above], drives[below], metric)
            difference = dataclasses.asdict(compared.difference) if compared else None
            claims.append({"above": above, "below": below, "metric": metric, "verdict": word, "difference": difference})
    driven = {"benchmark": benchmark, "part": part, "per_type": per_type, "cells": cells}
    return driven | {"arms": arms, "claims": claims}


def main() -> None:
    """Command-line entry point."""
    parser = argparse.ArgumentParser(prog="python -m dohyo.agents.mcts.study", description=__doc__)
    parser.add_argument("--benchmark", default="val14")
    parser.add_argument("--arms", nargs="*", default=list(ARMS), choices=list(ARMS), metavar="ARM")
    parser.add_argument("--seeds", type=int, nargs="*", help="default: the benchmark's own")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--part", choices=get_args(Part), default="all", help="of a benchmark of excerpts")
    parser.add_argument("--per-type", type=int, help="upper bound of scenarios of each type")
    parser.add_argument("--cells", default="", help="prefix of their names")
    parser.add_argument("--results", action="store_true", help="write the tables into RESULTS.md")
    given = parser.parse_args()
    document = run(
        given.benchmark, given.arms, given.seeds, given.out, given.workers, given.part, given.per_type, given.cells
    )  # fmt: skip
    print(tables(document))
    if given.results:
        write_section(Path(__file__).with_name(PAGE), section(document), tables(document))


if __name__ == "__main__":
    main()
