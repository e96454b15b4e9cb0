"""Study: the arms of GHRL on the same scenarios of a benchmark, or on a sample. The same command resumes.

    python -m dohyo.agents.hierarchical.study --benchmark precrash --arms rules ghrl-r --out out/ghrl
    python -m dohyo.agents.hierarchical.study --benchmark nocrash --cells town-test. --every 5 --arms hrl ghrl ghrl-r \
        --runs runs/study --seeds-of-training 0 1 2 --workers 2 --out out/ghrl
    python -m dohyo.agents.hierarchical.study --table --arms ghrl ghrl-r --out out/ghrl

Scenarios are sampled by their number in the benchmark, so every arm drives the same ones. With --runs, a
learned arm is driven once for each training, RUNS/ARM/seed-N; without it, the shipped policies are. A line per drive
goes to OUT/BENCHMARK.jsonl: the results of `dohyo evaluate`, and the work of the rules, which no record holds. The
tables are those of `study_tables`.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

from dohyo.agents.hierarchical.ghrl import CHECKPOINT
from dohyo.agents.hierarchical.study_tables import Drive, read_drives, tables
from dohyo.agents.registry import resolve_with
from dohyo.agents.results_page import PAGE, write_section
from dohyo.agents.safety.rss_monitor import STANDS_M_S
from dohyo.evaluation.agent import Agent, Observation, make_agent
from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.evaluation.episode.runner import drive_episode
from dohyo.evaluation.records.record import EgoRecord
from dohyo.evaluation.records.specifications import Status
from dohyo.evaluation.running.lock import held
from dohyo.evaluation.scores.nocrash import drove, success
from dohyo.sumo_networks.errors import DohyoError, InvalidInputError
from dohyo.sumo_networks.files import write_atomically
from dohyo.sumo_networks.processes import worker_pool
from dohyo.sumo_networks.scenario import Scenario
from dohyo.sumo_networks.units import TICK_S

DEADLOCK_S = 30.0
"""Standing time in critical intervals at the end that makes a blocked or late drive a deadlock, s."""
LOOKS_S = 1.0


@dataclass(frozen=True, slots=True)
class Arm:
    """An agent, and the training that it uses.

    Attributes:
        agent: Registered name.
        settings: Of its constructor.
        trained: Folder of its trainings in RUNS; None without a training.
        watched: Whether RSS monitors its drives.
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
"""`hrl-r`: learned without rules, which drive in critical intervals; `ghrl-r-trained`: its master was trained while
they did."""

BY_DEFAULT = ("rules", "ghrl", "ghrl-r")


@dataclass(frozen=True, slots=True)
class Driver:
    """Driver: an arm, and its training.

    Attributes:
        arm: Of `ARMS`.
        seed: Of the training; None for shipped ones, and without a training.
        checkpoint: Folder of the training; None for the shipped one.
    """

    arm: str
    seed: int | None = None
    checkpoint: Path | None = None


def drivers(arms: Sequence[str], runs: Path | None, seeds: Sequence[int]) -> list[Driver]:
    """Drivers of a study; with RUNS, one for each seed of the training."""
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
    """Agent, read once in each process.

    Raises:
        InvalidInputError: A part of the training is missing or damaged.
    """
    arm, checkpoint = ARMS[driver.arm], driver.checkpoint
    if driver.arm == "hrl-r" and checkpoint is None:  # the agent's default is the shipped ghrl
        checkpoint = CHECKPOINT / "hrl"
    where = {} if checkpoint is None else {"checkpoint": str(checkpoint)}
    return make_agent(*resolve_with(arm.agent, {**arm.settings, **where}))


def scenarios_of(benchmark: str, cells: Sequence[str], seeds: Sequence[int], every: int) -> list[Scenario]:
    """Every n-th scenario of the cells whose names have one of the prefixes; of all cells without a prefix.

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
    """Present standing time of an ego in critical intervals, sampled once a second.

    Attributes:
        seconds: The standing time.
    """

    def __init__(self, agent: Agent) -> None:
        self._agent = agent
        self.seconds = 0.0

    def look(self, tick: int, observations: Mapping[str, Observation]) -> None:
        """Updates; called in every tick before the agent acts."""
        if tick % round(LOOKS_S / TICK_S):
            return
        stands = all(float(seen["speedometer"][0]) < STANDS_M_S for seen in observations.values())
        self.seconds = self.seconds + LOOKS_S if stands and _judgement(self._agent).get("critical") else 0.0


def drive(driver: Driver, scenario: Scenario) -> Drive:
    """Drives one scenario; line of the results."""
    agent, watched = agent_of(driver), ARMS[driver.arm].watched
    stand = Stand(agent)
    record, _ = drive_episode(scenario, {scenario.missions[0].name: agent}, show=stand.look if watched else None)
    ego = record.egos[0]
    return line(driver, scenario, ego) | (under_rules(ego.status, agent, stand.seconds) if watched else {})


def line(driver: Driver, scenario: Scenario, ego: EgoRecord) -> Drive:
    """Stored facts of one drive."""
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
    """Results of RSS and the rules in a drive; empty if the agent was not set up.

    Args:
        status: Of the drive.
        agent: After the drive.
        stood_s: Standing time in critical intervals at the end.
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
    """Lines of drives as they end: in this process, or in several, since SUMO is global in a process."""
    if workers == 1:
        yield from (drive(*job) for job in jobs)
        return
    pool = worker_pool(workers, drive)
    try:
        for done in as_completed([pool.submit(drive, *job) for job in jobs]):
            yield done.result()
    finally:
        pool.shutdown(cancel_futures=True)


def run(path: Path, who: Sequence[Driver], scenarios: Sequence[Scenario], workers: int = 1) -> None:
    """Drives what is missing in a file, and appends it line by line.

    Raises:
        InvalidInputError: An agent cannot be made, or another process drives into the same folder; nothing has been
            driven then.
    """
    for driver in who:
        agent_of(driver)
    with held(path.parent):
        _go_on(path, who, scenarios, workers)


def _go_on(path: Path, who: Sequence[Driver], scenarios: Sequence[Scenario], workers: int) -> None:
    # Without a torn last line, and without drives lost by the simulation, which are driven again.
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
    """Command-line entry point."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--benchmark", help="name; with --table only its tables")
    parser.add_argument("--cells", nargs="*", default=[], help="prefixes of their names; default: all")
    parser.add_argument("--seeds", nargs="*", type=int, default=[0], help="of the scenarios")
    parser.add_argument("--every", type=int, default=1, help="drive every n-th scenario")
    parser.add_argument("--arms", nargs="+", choices=[*ARMS], help="default: rules, ghrl and ghrl-r; with --table: all")
    parser.add_argument("--runs", type=Path, help="folder of ARM/seed-N; default: shipped policies")
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
