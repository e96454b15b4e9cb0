"""Benchmark `dissipation`, paired: `python -m dohyo.agents.speed_planning.study --seeds 0 1 2 --out out/dissipation`.

Every arm drives the same mornings; finished runs are not driven again. Seeds are driven in order, so that an
interrupted study has complete ones. Results go to OUT/study.json, and with --results into RESULTS.md.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import sys
import traceback
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any, get_args

from dohyo.agents.speed_planning.buffer import RuleBuffer
from dohyo.agents.speed_planning.dissipation import (
    DESIGNS,
    FORECASTS,
    Arm,
    LeadIn,
    Morning,
    SetPoints,
    buffer_policy,
    controlled,
    run,
    segment_speeds,
    watched,
)
from dohyo.agents.studies.tables import PAGE, write_section
from dohyo.evaluation.scores.traffic import Outcome
from dohyo.evaluation.statistics import Comparison, Estimate, mean_estimate, paired
from dohyo.sumo_networks.errors import InvalidInputError, SimulationError
from dohyo.sumo_networks.files import write_atomically
from dohyo.sumo_networks.freeway.simulation import FreewaySimulation
from dohyo.sumo_networks.processes import worker_pool

SHOWN = {
    "throughput_vph": ("throughput, veh/h", 0),
    "speed_mps": ("speed, m/s", 2),
    "speed_std_mps": ("its deviation, m/s", 2),
    "speed_std_within_mps": ("within a minute, m/s", 2),
    "fuel_circles_g_km": ("fuel CIRCLES, g/km", 1),
    "fuel_sumo_g_km": ("fuel SUMO, g/km", 1),
    "least_headway_s": ("least headway, s", 2),
    "least_ttc_s": ("least TTC, s", 2),
    "collisions": ("collisions", 1),
}
"""Metrics of the tables: head and decimals."""
COMPARED = ("throughput_vph", "speed_std_mps", "speed_std_within_mps", "fuel_circles_g_km")
Runs = dict[str, dict[int, dict[str, float]]]
"""Outcomes by arm and seed."""

ARMS: Mapping[str, Arm] = {
    arm.name: arm
    for arm in (Arm(), *(Arm(design, forecast) for design, forecast in product(DESIGNS[1:], FORECASTS)))  # type: ignore[arg-type]
}


def run_path(out: Path, arm: str, seed: int) -> Path:
    """File of the outcome of one run."""
    return out / arm / f"seed-{seed:03}.json"


def drive_seed(out: Path, arms: Sequence[str], seed: int, morning: Morning, forecaster: str) -> int:
    """Drives the missing runs of one seed; their number.

    The lead-in is the same for every arm, so it is driven once, and each arm continues in a copy of the process: SUMO's
    state reaches no other run, and each run equals that of `dissipation.run`.

    Raises:
        InvalidInputError: A run is there, but of another morning or network.
        SimulationError: A run failed.
    """
    missing = [name for name in arms if not is_done(run_path(out, name, seed), settings_of(morning, forecaster))]
    if not missing:
        return 0
    with FreewaySimulation(morning.scenario(seed), fuel=False) as simulation:
        lead_in = LeadIn.driven(simulation, seed, morning.start_s)
        for name in missing:
            in_a_copy(f"{name}, seed {seed}", partial(drive_on, out, name, lead_in, morning, forecaster))
    return len(missing)


def drive(out: Path, name: str, seed: int, morning: Morning, forecaster: str) -> None:
    """Drives one run with its own lead-in, unless it is stored; needs a process of its own.

    Raises:
        InvalidInputError: It is there, but of another morning or network.
        SimulationError: SUMO failed.
    """
    if not is_done(run_path(out, name, seed), settings_of(morning, forecaster)):
        keep(out, name, seed, morning, forecaster, run(ARMS[name], seed, morning, forecaster))


def drive_on(out: Path, name: str, lead_in: LeadIn, morning: Morning, forecaster: str) -> None:
    """Drives one run from a lead-in, and prints the outcome."""
    outcome = watched(controlled(lead_in, ARMS[name], morning, forecaster))
    keep(out, name, lead_in.seed, morning, forecaster, outcome)
    found = f"{outcome.throughput_vph:.0f} veh/h, deviation {outcome.speed_std_mps:.2f} m/s"
    print(f"{name}, seed {lead_in.seed}: {found}", flush=True)


def keep(out: Path, name: str, seed: int, morning: Morning, forecaster: str, outcome: Outcome) -> None:
    """Writes the outcome of one run."""
    path, settings = run_path(out, name, seed), settings_of(morning, forecaster)
    path.parent.mkdir(parents=True, exist_ok=True)
    document = {"arm": name, "seed": seed, "settings": settings, "outcome": outcome.as_dict()}
    write_atomically(path, json.dumps(document, indent=1).encode())


def is_done(path: Path, settings: dict[str, Any]) -> bool:
    """Whether a run is stored.

    Raises:
        InvalidInputError: It is, but of another morning or network.
    """
    if not path.exists():
        return False
    if json.loads(path.read_text())["settings"] != settings:
        raise InvalidInputError(f"'{path}' was driven with other settings: expected {settings}; choose another --out")
    return True


def in_a_copy(what: str, work: Callable[[], None]) -> None:
    """Runs work in a copy of this process, and waits for it; this process stays unchanged.

    Raises:
        SimulationError: The work failed; the copy has printed why.
    """
    sys.stdout.flush()
    copy = os.fork()
    if copy == 0:
        status = 1
        try:
            work()
            status = 0
        except BaseException:
            traceback.print_exc()
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(status)
    if os.waitpid(copy, 0)[1]:
        raise SimulationError(f"{what}: the run failed; see the output of its process")


def settings_of(morning: Morning, forecaster: str) -> dict[str, Any]:
    """Settings of a run besides arm and seed, as plain JSON."""
    rule = {one.name: getattr(RuleBuffer(), one.name) for one in dataclasses.fields(RuleBuffer) if one.init}
    settings = {**dataclasses.asdict(morning), "rule": rule, "forecaster": forecaster}
    plain: dict[str, Any] = json.loads(json.dumps(settings))
    return plain


def drive_all(
    out: Path, arms: Sequence[str], seeds: Sequence[int], morning: Morning, forecaster: str, workers: int
) -> None:
    """All runs, seed by seed.

    Raises:
        InvalidInputError: An arm needs a trained network that is missing; before anything is driven.
    """
    for name in arms:
        segment_speeds(ARMS[name].forecast, forecaster)
        buffer_policy(ARMS[name].design)
    # SUMO is global in a process, and its state must not reach the next seed: one process each.
    with worker_pool(workers, drive_seed, max_tasks_per_child=1) as pool:
        jobs = {seed: pool.submit(drive_seed, out, arms, seed, morning, forecaster) for seed in seeds}
        for seed, job in jobs.items():
            print(f"seed {seed}: {job.result()} runs driven, {len(arms)} there", flush=True)


def collect(out: Path, arms: Iterable[str] = ARMS) -> Runs:
    """Stored outcomes."""
    found: Runs = {}
    for name in arms:
        for path in sorted((out / name).glob("seed-*.json")):
            document = json.loads(path.read_text())
            found.setdefault(name, {})[document["seed"]] = document["outcome"]
    return found


def compared(runs: Runs, arm: str, other: str, metric: str) -> tuple[Comparison, float] | None:
    """Arm against another on common seeds, and the other's mean; None without two such seeds."""
    seeds = sorted(runs.get(arm, {}).keys() & runs.get(other, {}).keys())
    if len(seeds) < 2:
        return None
    base = [runs[other][seed][metric] for seed in seeds]
    return paired([runs[arm][seed][metric] for seed in seeds], base), sum(base) / len(base)


def tables(runs: Runs) -> str:
    """The study as Markdown: every arm, every arm against none, and the effect of a better forecast."""
    heads = [head for head, _ in SHOWN.values()]
    lines = ["| arm | n | " + " | ".join(heads) + " |", "|---" * (len(heads) + 2) + "|"]
    for name, by_seed in runs.items():
        cells = [
            _shown(mean_estimate([one[key] for one in by_seed.values()]), digits) for key, (_, digits) in SHOWN.items()
        ]
        lines.append(f"| {name} | {len(by_seed)} | " + " | ".join(cells) + " |")
    lines += [
        "",
        "Against `none`, same seeds, %:",
        "",
        *_differences(runs, [(name, "none") for name in runs if name != "none"]),
    ]
    better = [
        (f"{design}+{forecast}", f"{design}+persistence")
        for design in DESIGNS[1:]
        for forecast in ("sa-lstm", "oracle", "none")
    ]
    lines += ["", "Another forecast against persistence, same seeds, %:", "", *_differences(runs, better)]
    return "\n".join(lines)


def _differences(runs: Runs, pairs: Iterable[tuple[str, str]]) -> list[str]:
    heads = [SHOWN[metric][0].split(",")[0] for metric in COMPARED]
    lines = ["| arm | against | n | " + " | ".join(heads) + " |", "|---" * (len(heads) + 3) + "|"]
    for arm, other in pairs:
        found = [compared(runs, arm, other, metric) for metric in COMPARED]
        if found[0] is not None:
            cells = [_percent(*one) for one in found if one is not None]
            lines.append(f"| {arm} | {other} | {found[0][0].difference.n} | " + " | ".join(cells) + " |")
    return lines


def _percent(comparison: Comparison, base: float) -> str:
    """A difference as a share of the base's mean, %, with its interval and verdict."""
    difference = comparison.difference
    if difference.mean is None or difference.low is None or difference.high is None:
        return ""
    mean, low, high = (100 * value / base for value in (difference.mean, difference.low, difference.high))
    return f"{mean:+.1f} [{low:+.1f}, {high:+.1f}] {comparison.verdict}"


def _shown(estimate: Estimate, digits: int) -> str:
    if estimate.mean is None:
        return ""
    if estimate.low is None or estimate.high is None:
        return f"{estimate.mean:.{digits}f}"
    return f"{estimate.mean:.{digits}f} [{estimate.low:.{digits}f}, {estimate.high:.{digits}f}]"


def main() -> None:
    """Command-line entry point."""
    default = Morning()
    parser = argparse.ArgumentParser(prog="python -m dohyo.agents.speed_planning.study", description=__doc__)
    parser.add_argument("--seeds", type=int, nargs="*", default=list(range(10)))
    parser.add_argument("--arms", nargs="*", default=list(ARMS), choices=list(ARMS), metavar="ARM")
    parser.add_argument("--penetration", type=float, default=default.penetration)
    parser.add_argument("--minutes", type=float, default=default.duration_s / 60, help="of control and measurement")
    parser.add_argument("--set-points", choices=get_args(SetPoints), default=default.set_points)
    parser.add_argument("--kernel", type=float, default=default.planner.kernel_m, help="width of the forward kernel, m")
    parser.add_argument("--headroom", type=float, default=default.planner.headroom, help="factor on the smoothed state")
    parser.add_argument("--forecaster", default="sa-lstm", help="shipped name or file behind the forecast sa-lstm")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--results", action="store_true", help="write the tables into RESULTS.md")
    given = parser.parse_args()
    morning = dataclasses.replace(
        default,
        penetration=given.penetration,
        set_points=given.set_points,
        duration_s=60 * given.minutes,
        planner=dataclasses.replace(default.planner, kernel_m=given.kernel, headroom=given.headroom),
    )
    drive_all(given.out, given.arms, given.seeds, morning, given.forecaster, given.workers)
    runs = collect(given.out)
    write_atomically(
        given.out / "study.json",
        json.dumps({"settings": settings_of(morning, given.forecaster), "runs": runs}, indent=1).encode(),
    )
    text = tables(runs)
    print(text)
    if given.results:
        write_section(Path(__file__).with_name(PAGE), "dissipation", text)


if __name__ == "__main__":
    main()
