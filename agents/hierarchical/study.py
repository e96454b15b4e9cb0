"""Study: the arms of GHRL on the same scenarios of a benchmark, or on a sample of it; run again, it goes on.

    python -m dohyo.agents.hierarchical.study --benchmark precrash --arms rules ghrl-r --out out/ghrl
    python -m dohyo.agents.hierarchical.study --benchmark nocrash --cells town-test. --every 5 --arms hrl ghrl ghrl-r \
        --runs runs/study --seeds-of-training 0 1 2 --workers 2 --out out/ghrl
    python -m dohyo.agents.hierarchical.study --table --arms ghrl ghrl-r --out out/ghrl

Scenarios are sampled by their number in the benchmark, so every arm drives the same ones. With --runs, an arm that
learned is driven once for each training, RUNS/ARM/seed-N; without, what ships is. A line per drive goes to
OUT/BENCHMARK.jsonl: what `dohyo evaluate` counts, and what the rules had to do, which no record holds. The tables are
those of `study_tables`.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from types import MappingProxyType
from typing import Any

from dohyo.agents.hierarchical.ghrl import CHECKPOINT
from dohyo.agents.hierarchical.study_tables import Drive, read_drives, tables
from dohyo.agents.hierarchical.watch import STANDS_M_S
from dohyo.agents.registry import resolve_with
from dohyo.agents.results_page import PAGE, write_section
from dohyo.evaluation.agent import Agent, Observation, make_agent
from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.evaluation.episode.runner import drive_episode
from dohyo.evaluation.records.record import EgoRecord, Status
from dohyo.evaluation.running.lock import held
from dohyo.evaluation.scores.nocrash import drove, success
from dohyo.sumo_networks.errors import DohyoError, InvalidInputError
from dohyo.sumo_networks.files import write_atomically
from dohyo.sumo_networks.scenario import Scenario
from dohyo.sumo_networks.units import TICK_S

DEADLOCK_S = 30.0
"""So long an ego that got blocked or ran out of time must have stood within critical intervals at the end."""
LOOKS_S = 1.0


@dataclass(frozen=True, slots=True)
class Arm:
    """An agent, and whose training drives.

    Attributes:
        agent: Registered name.
        settings: Of its constructor.
        trained: Folder of RUNS that its trainings are in; None where nothing was learned.
        watched: Whether RSS watches its drives.
    """

    agent: str
    settings: Mapping[str, str] = field(default_factory=dict)
    trained: str | None = None
    watched: bool = False


def _ghrl(arm: str, trained: str) -> Arm:
    return Arm("ghrl", MappingProxyType({"arm": arm}), trained, watched=arm in ("ghrl-r", "ghrl-s"))


ARMS: Mapping[str, Arm] = MappingProxyType(
    {
        "rules": Arm("rules", watched=True),
        "hrl": _ghrl("hrl", "hrl"),
        "hrl-r": _ghrl("ghrl-r", "hrl"),
        "ghrl": _ghrl("ghrl", "ghrl"),
        "ghrl-r": _ghrl("ghrl-r", "ghrl"),
        "ghrl-r-trained": _ghrl("ghrl-r", "ghrl-r"),
        "ghrl-s": _ghrl("ghrl-s", "ghrl"),
        "flat": _ghrl("flat", "flat"),
        "flat-guided": _ghrl("flat", "flat-guided"),
        "ghrl-pictures": _ghrl("ghrl", "ghrl-pictures"),
        "ghrl-r-pictures": _ghrl("ghrl-r", "ghrl-pictures"),
        "autopilot": Arm("autopilot"),
    }
)
"""`hrl-r`: what was learned without rules, which drive in critical intervals; `ghrl-r-trained`: a master that learned
while they did."""

BY_DEFAULT = ("rules", "ghrl", "ghrl-r")


@dataclass(frozen=True, slots=True)
class Driver:
    """Who drives: an arm, and which training of it.

    Attributes:
        arm: Of `ARMS`.
        seed: Of the training; None for what ships, and where nothing was learned.
        checkpoint: Folder of the training; None for what ships.
    """

    arm: str
    seed: int | None = None
    checkpoint: Path | None = None


def drivers(arms: Sequence[str], runs: Path | None, seeds: Sequence[int]) -> list[Driver]:
    """Who drives in a study; a driver for each seed of the training where RUNS is given."""
    found = []
    for name in arms:
        trained = ARMS[name].trained
        if runs is None or trained is None:
            found.append(Driver(name))
        else:
            found += [Driver(name, seed, runs / trained / f"seed-{seed}") for seed in seeds]
    return found


@cache
def agent_of(driver: Driver) -> Agent:
    """The agent, read once in each process.

    Raises:
        InvalidInputError: A part of the training is missing or damaged.
    """
    arm, checkpoint = ARMS[driver.arm], driver.checkpoint
    if driver.arm == "hrl-r" and checkpoint is None:  # by itself the agent would take what ships for ghrl
        checkpoint = CHECKPOINT / "hrl"
    where = {} if checkpoint is None else {"checkpoint": str(checkpoint)}
    return make_agent(*resolve_with(arm.agent, {**arm.settings, **where}))


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


class Stand:
    """How long an ego has stood within critical intervals up to now, looked at once a second.

    Attributes:
        seconds: That long.
    """

    def __init__(self, agent: Agent) -> None:
        self._agent = agent
        self.seconds = 0.0

    def look(self, tick: int, observations: Mapping[str, Observation]) -> None:
        """Goes on; called in every tick before the agent acts."""
        if tick % round(LOOKS_S / TICK_S):
            return
        stands = all(float(seen["speedometer"][0]) < STANDS_M_S for seen in observations.values())
        self.seconds = self.seconds + LOOKS_S if stands and _judgement(self._agent).get("critical") else 0.0


def drive(driver: Driver, scenario: Scenario) -> Drive:
    """Drives one scenario; its line."""
    agent, watched = agent_of(driver), ARMS[driver.arm].watched
    stand = Stand(agent)
    record, _ = drive_episode(scenario, {scenario.missions[0].name: agent}, show=stand.look if watched else None)
    ego = record.egos[0]
    return line(driver, scenario, ego) | (under_rules(ego.status, agent, stand.seconds) if watched else {})


def line(driver: Driver, scenario: Scenario, ego: EgoRecord) -> Drive:
    """What is kept of one drive."""
    return {
        "arm": driver.arm,
        "training_seed": driver.seed,
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
    }


def under_rules(status: Status, agent: Agent, stood_s: float) -> Drive:
    """What RSS and the rules came to in a drive; empty where the agent was never set up.

    Args:
        status: How it ended.
        agent: After it.
        stood_s: How long the ego had stood within critical intervals then.
    """
    judged = _judgement(agent)
    if not judged:
        return {}
    kept = {name: judged[name] for name in ("critical_share", "longest_standing_s")}
    return kept | {"deadlock": status in (Status.BLOCKED, Status.TIMED_OUT) and stood_s >= DEADLOCK_S}


def _judgement(agent: Agent) -> Mapping[str, Any]:
    judged: Mapping[str, Any] = (agent.explain() or {}).get("rss", {})
    return judged


def drive_all(jobs: Sequence[tuple[Driver, Scenario]], workers: int) -> Iterator[Drive]:
    """The lines of drives as they end: here, or in processes of their own, since SUMO is global in one."""
    if workers == 1:
        yield from (drive(*job) for job in jobs)
        return
    pool = ProcessPoolExecutor(workers, mp_context=get_context("spawn"))
    try:
        for done in as_completed([pool.submit(drive, *job) for job in jobs]):
            yield done.result()
    finally:
        pool.shutdown(cancel_futures=True)


def run(path: Path, who: Sequence[Driver], scenarios: Sequence[Scenario], workers: int = 1) -> None:
    """Drives what is not yet in a file, and appends it line by line.

    Raises:
        InvalidInputError: An agent cannot be made, or another process drives into the same folder; nothing has been
            driven then.
    """
    for driver in who:
        agent_of(driver)
    with held(path.parent):
        _go_on(path, who, scenarios, workers)


def _go_on(path: Path, who: Sequence[Driver], scenarios: Sequence[Scenario], workers: int) -> None:
    # Without a torn last line, and without what the simulation lost, which is driven again.
    kept = [one for one in read_drives(path) if one["status"] != Status.SIMULATION.value]
    write_atomically(path, "".join(json.dumps(one) + "\n" for one in kept).encode())
    done = {(one["arm"], one["training_seed"], one["scenario"], one["seed"]) for one in kept}
    jobs = [
        (driver, scenario)
        for scenario in scenarios
        for driver in who
        if (driver.arm, driver.seed, scenario.name, scenario.seed) not in done
    ]
    with path.open("a") as file:
        for one in drive_all(jobs, workers):
            file.write(json.dumps({"benchmark": path.stem, **one}) + "\n")
            file.flush()


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--benchmark", help="with --table: its tables alone")
    parser.add_argument("--cells", nargs="*", default=[], help="beginnings of their names; default: all")
    parser.add_argument("--seeds", nargs="*", type=int, default=[0], help="of the scenarios")
    parser.add_argument("--every", type=int, default=1, help="drive every n-th scenario")
    parser.add_argument("--arms", nargs="+", choices=[*ARMS], help="default: rules, ghrl and ghrl-r; with --table: all")
    parser.add_argument("--runs", type=Path, help="folder of ARM/seed-N; default: what ships")
    parser.add_argument("--seeds-of-training", nargs="*", type=int, default=[0, 1, 2], help="N; only with --runs")
    parser.add_argument("--workers", type=int, default=1, help="processes")
    parser.add_argument("--out", type=Path, default=Path("out/hierarchical"))
    parser.add_argument("--table", action="store_true", help="print the tables of stored drives; drive nothing")
    parser.add_argument("--results", metavar="SECTION", help="write the tables into that section of RESULTS.md")
    given = parser.parse_args(arguments)
    paths = [given.out / f"{given.benchmark}.jsonl"] if given.benchmark else sorted(given.out.glob("*.jsonl"))
    if not given.table:
        if given.benchmark is None:
            raise InvalidInputError("expected --benchmark, or --table; got neither")
        who = drivers(given.arms or BY_DEFAULT, given.runs, given.seeds_of_training)
        scenarios = scenarios_of(given.benchmark, given.cells, given.seeds, given.every)
        run(paths[0], who, scenarios, given.workers)
    arms = given.arms if given.table and given.arms else [*ARMS]
    drives = [one for path in paths for one in read_drives(path) if one["arm"] in arms]
    if not drives:
        raise InvalidInputError(f"'{given.out}': expected drives in BENCHMARK.jsonl, found none")
    text = tables(drives, arms)
    print(text)
    if given.results:
        write_section(Path(__file__).with_name(PAGE), given.results, text)


if __name__ == "__main__":
    try:
        main()
    except DohyoError as error:
        sys.exit(f"study: {error}")
