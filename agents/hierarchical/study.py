"""Study: the arms of GHRL on the same scenarios of a benchmark, or on a sample of it; run again, it goes on.

    python -m agents.hierarchical.study --benchmark nocrash --cells town-test.empty.test --every 5 --out out/ghrl
    python -m agents.hierarchical.study --benchmark precrash --arms rules ghrl-r --out out/ghrl

Scenarios are sampled by their number in the benchmark, so every arm drives the same ones. A line per drive goes to
OUT/BENCHMARK.jsonl: what `dohyo evaluate` counts, and the share of the time under rules, which no record holds.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

from agents.registry import resolve_with
from evaluation.agent import Agent, make_agent
from evaluation.benchmark import load_benchmark
from evaluation.figures import interval
from evaluation.record import EgoRecord
from evaluation.runner import run_episode
from evaluation.scores.nocrash import drove, success
from evaluation.statistics import Estimate, share_estimate
from evaluation.store import write_atomically
from sumo_networks.errors import DohyoError, InvalidInputError
from sumo_networks.scenario import Scenario

ARMS: Mapping[str, tuple[str, Mapping[str, Any]]] = MappingProxyType(
    {
        "rules": ("rules", {}),
        "hrl": ("ghrl", {"arm": "hrl"}),
        "ghrl": ("ghrl", {"arm": "ghrl"}),
        "ghrl-r": ("ghrl", {"arm": "ghrl-r"}),
        "flat": ("ghrl", {"arm": "flat"}),
        "autopilot": ("autopilot", {}),
    }
)
Drive = dict[str, Any]


def scenarios_of(benchmark: str, cells: Sequence[str], seeds: Sequence[int], every: int) -> list[Scenario]:
    """Every n-th scenario of the cells whose names begin with one of those given; all cells where none is.

    Raises:
        UnknownNameError: There is no such benchmark.
        InvalidInputError: No scenario is left.
    """
    found = [
        scenario
        for scenario in load_benchmark(benchmark).scenarios(seeds)
        if not cells or any(scenario.cell.startswith(cell) for cell in cells)
    ][::every]
    if not found:
        raise InvalidInputError(f"benchmark '{benchmark}' has no scenario in cells {', '.join(cells)}")
    return found


def drive(arm: str, agent: Agent, scenario: Scenario) -> Drive:
    """Drives one scenario; its line."""
    record = run_episode(scenario, {scenario.missions[0].name: agent})
    return line(arm, scenario, record.egos[0], agent)


def line(arm: str, scenario: Scenario, ego: EgoRecord, agent: Agent) -> Drive:
    """What is kept of one drive."""
    return {
        "arm": arm,
        "cell": scenario.cell,
        "scenario": scenario.name,
        "seed": scenario.seed,
        "event": scenario.events[0].kind if scenario.events else None,
        "status": ego.status.value,
        "success": success(ego),
        "drove_2500m": drove(ego) if ego.route_length_m >= 2500.0 else None,
        "progress": round(ego.progress_m / ego.route_length_m, 4),
        "infractions": [one.kind.value for one in ego.infractions],
        "duration_s": ego.duration_s,
        **_under_rules(agent),
    }


def _under_rules(agent: Agent) -> dict[str, float]:
    told = agent.explain() or {}
    watch = told.get("rss", told)
    return {name: watch[name] for name in ("critical_share", "longest_standing_s") if name in watch}


def successes(drives: Iterable[Drive]) -> Estimate:
    """NoCrash success of some drives, %, with Wilson's 95 % interval; lost ones are in no mean."""
    return share_estimate([bool(one["success"]) for one in drives if not one["status"].startswith("lost")])


def failures(drives: Iterable[Drive]) -> Counter[str]:
    """How drives failed: by the collision's kind, or by how they ended."""
    found: Counter[str] = Counter()
    for one in drives:
        if not one["success"]:
            hits = [kind for kind in one["infractions"] if kind.startswith("collision")]
            found[hits[0] if hits else one["status"].removeprefix("failed: ")] += 1
    return found


def table(drives: Sequence[Drive]) -> str:
    """Markdown: a row per cell and arm."""
    rows = ["| cell | arm | success, % | failures | red lights | time in critical intervals |", "|" + "---|" * 6]
    for cell in dict.fromkeys(one["cell"] for one in drives):
        for arm in dict.fromkeys(one["arm"] for one in drives):
            some = [one for one in drives if (one["cell"], one["arm"]) == (cell, arm)]
            if some:
                rows.append(f"| {cell} | {_row(arm, some)} |")
    arms = dict.fromkeys(one["arm"] for one in drives)
    rows += [f"| all | {_row(arm, [one for one in drives if one['arm'] == arm])} |" for arm in arms]
    return "\n".join(rows)


def _row(arm: str, some: Sequence[Drive]) -> str:
    failed = ", ".join(f"{count} {kind}" for kind, count in failures(some).most_common()) or "none"
    red = sum(one["infractions"].count("red_light") for one in some)
    watched = [one for one in some if "critical_share" in one]
    seconds = sum(one["duration_s"] for one in watched)
    critical = sum(one["critical_share"] * one["duration_s"] for one in watched)
    share = f"{100 * critical / seconds:.1f} %" if seconds else "not watched"
    return f"{arm} | {interval(successes(some))} | {failed} | {red} | {share}"


def read_drives(path: Path) -> list[Drive]:
    """The lines so far; a torn last one is left out."""
    drives = []
    for text in path.read_text().splitlines() if path.exists() else ():
        try:
            drives.append(json.loads(text))
        except json.JSONDecodeError:
            continue
    return drives


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--benchmark", required=True)
    parser.add_argument("--cells", nargs="*", default=[], help="beginnings of their names; default: all")
    parser.add_argument("--seeds", nargs="*", type=int, default=[0])
    parser.add_argument("--every", type=int, default=1, help="drive every n-th scenario")
    parser.add_argument("--arms", nargs="*", choices=[*ARMS], default=["rules", "ghrl", "ghrl-r"])
    parser.add_argument("--checkpoint", help="folder of the runs; default: what ships")
    parser.add_argument("--out", type=Path, default=Path("out/hierarchical"))
    given = parser.parse_args(arguments)
    scenarios = scenarios_of(given.benchmark, given.cells, given.seeds, given.every)
    given.out.mkdir(parents=True, exist_ok=True)
    path = given.out / f"{given.benchmark}.jsonl"
    drives = read_drives(path)
    write_atomically(path, "".join(json.dumps(one) + "\n" for one in drives).encode())  # without what was torn
    done = {(one["arm"], one["cell"], one["scenario"], one["seed"]) for one in drives}
    agents = {arm: _agent(arm, given.checkpoint) for arm in given.arms}
    with path.open("a") as file:
        for scenario in scenarios:
            for arm, agent in agents.items():
                if (arm, scenario.cell, scenario.name, scenario.seed) not in done:
                    drives.append(drive(arm, agent, scenario))
                    file.write(json.dumps(drives[-1]) + "\n")
                    file.flush()
    print(table(drives))


def _agent(arm: str, checkpoint: str | None) -> Agent:
    name, settings = ARMS[arm]
    if name == "ghrl" and checkpoint:
        settings = {**settings, "checkpoint": checkpoint}
    return make_agent(*resolve_with(name, settings))


if __name__ == "__main__":
    try:
        main()
    except DohyoError as error:
        sys.exit(f"study: {error}")
