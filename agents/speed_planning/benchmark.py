"""Benchmark `dissipation`: one controller of connected cars on its mornings, beside the same mornings without control.

A finished run is not driven again; uncontrolled runs are driven once for all results, and stored.
"""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

from dohyo.agents.forecasting.registry import CHECKPOINTS
from dohyo.agents.learning.files.card import digest
from dohyo.agents.speed_planning import acc, buffer
from dohyo.agents.speed_planning.study.dissipation import Arm, Morning, SetPoints, buffer_policy, segment_speeds
from dohyo.agents.speed_planning.study.mornings import ARMS, drive_morning, morning_place
from dohyo.agents.studies.arms import Cell
from dohyo.agents.studies.rows import cell_of, read_rows
from dohyo.agents.studies.runner import Work, run
from dohyo.agents.studies.study import ROWS
from dohyo.evaluation.freeway.benchmark import TrafficBenchmark
from dohyo.evaluation.freeway.result import AgentFacts, FreewayResult, Metric, Units, claim, write_result
from dohyo.evaluation.settings import check_against, check_settings
from dohyo.evaluation.sources import source_files
from dohyo.sumo_networks.errors import SimulationError, UnknownNameError
from dohyo.sumo_networks.freeway.dataset import DatasetRequest, dataset_facts
from dohyo.sumo_networks.networks.entries import user_catalog
from dohyo.sumo_networks.scenario import content_hash

PLANNER, NOBODY = "speed-planner", "none"

METRICS = (
    Metric("speed_std_mps", "standard deviation of all speeds", "m/s", "lower"),
    Metric("throughput_vph", "throughput past the bottleneck", "veh/h", "higher"),
    Metric("speed_mps", "mean speed", "m/s", "higher"),
    Metric("speed_std_within_mps", "standard deviation within a minute", "m/s", "lower"),
    Metric("fuel_circles_g_km", "fuel, CIRCLES model", "g/km", "lower"),
    Metric("fuel_sumo_g_km", "fuel, SUMO's model", "g/km", "lower"),
    Metric("least_headway_s", "least time gap", "s", "higher"),
    Metric("least_ttc_s", "least time to collision", "s", "higher"),
    Metric("collisions", "collisions", "per morning", "lower"),
)
Progress = Callable[[int, int, float], None]
"""Called with: finished runs, their number, and 0."""


@dataclasses.dataclass(frozen=True, slots=True)
class PlannerSettings:
    """Settings of `speed-planner`.

    Attributes:
        design: Design of the buffer before the bottleneck; "none": no control.
        forecast: Source of the forecast.
        forecaster: Network of the forecast.
        set_points: Source of the cruise controls' set-points.
    """

    design: str = "limit"
    forecast: str = "sa-lstm"
    forecaster: str = "sa-lstm"
    set_points: SetPoints = "none"


def evaluate_controller(
    benchmark: TrafficBenchmark,
    name: str,
    settings: Mapping[str, Any],
    seeds: Sequence[int] | None,
    out: Path,
    workers: int = 1,
    progress: Progress = lambda _done, _of, _share: None,
) -> FreewayResult:
    """Drives missing mornings, with the controller and without control, and writes the result.

    Args:
        benchmark: Set of mornings.
        name: `speed-planner`, or `none`.
        settings: Of the planner, see `PlannerSettings`.
        seeds: One morning each; None: the benchmark's.
        out: Folder of the result.
        workers: Processes.
        progress: Called as runs end.

    Raises:
        InvalidInputError: An unknown name or setting, a missing network, or a folder of another result.
        SimulationError: SUMO failed.
    """
    arm, morning, forecaster = controller(benchmark, name, settings)
    seeds = benchmark.seeds if seeds is None else tuple(seeds)
    facts = AgentFacts(name, dict(settings), _sources())
    claim(out, benchmark, facts)
    order = dataset_facts(DatasetRequest(days=0, network=benchmark.network))
    versions = {key: str(order[key]) for key in ("dohyo", "sumo", "network_sha256")}
    untouched, own = untouched_folder(benchmark, versions), _own_folder(out, facts, forecaster, versions)
    folders = {untouched: (NOBODY, PlannerSettings().forecaster)}
    if arm != NOBODY:
        folders[own] = (arm, forecaster)
    total = len(folders) * len(seeds)
    for number, (folder, (driven, network)) in enumerate(folders.items()):
        work = partial(drive_morning, morning, network)
        _drive(folder, driven, seeds, work, workers, partial(_told, progress, number * len(seeds), total))
    theirs = _units(untouched, NOBODY, seeds)
    result = FreewayResult(
        benchmark=benchmark,
        agent=facts,
        reference=NOBODY,
        metrics=METRICS,
        units=theirs if arm == NOBODY else _units(own, arm, seeds),
        reference_units=theirs,
        versions=versions,
    )
    write_result(out, result)
    return result


def controller(benchmark: TrafficBenchmark, name: str, settings: Mapping[str, Any]) -> tuple[str, Morning, str]:
    """Name of the arm, morning, and network of a controller by its name and settings.

    Raises:
        InvalidInputError: There is no such controller, or its network is missing.
    """
    if name not in (PLANNER, NOBODY):
        raise UnknownNameError("controller of connected cars", name, (PLANNER, NOBODY))
    if name == PLANNER:
        check_settings(PlannerSettings, f"controller '{name}'", settings)
    else:
        check_against({"properties": {}}, f"controller '{name}'", settings)
    given = PlannerSettings(**settings)
    arm = NOBODY if NOBODY in (name, given.design) else f"{given.design}+{given.forecast}"
    if arm not in ARMS:
        raise UnknownNameError("arm", arm, ARMS)
    segment_speeds(ARMS[arm].forecast, given.forecaster)  # these raise before anything is driven
    buffer_policy(ARMS[arm].design)
    morning = dataclasses.replace(morning_of(benchmark), set_points=given.set_points)
    return arm, morning, given.forecaster


def morning_of(benchmark: TrafficBenchmark) -> Morning:
    """A benchmark's morning."""
    return Morning(
        start_s=benchmark.start_s,
        duration_s=benchmark.duration_s,
        warm_up_s=benchmark.warm_up_s,
        penetration=benchmark.penetration,
    )


def untouched_folder(benchmark: TrafficBenchmark, versions: Mapping[str, str]) -> Path:
    """Folder of uncontrolled runs by this code: $DOHYO_HOME/freeway, else in the user's data folder."""
    decides = {"benchmark": benchmark.sha256, "versions": dict(versions), "sources": _sources()}
    return user_catalog().with_name("freeway") / content_hash(decides)[:16]


def _own_folder(out: Path, facts: AgentFacts, forecaster: str, versions: Mapping[str, str]) -> Path:
    """Folder of a controller's runs: other settings, code or weights never go on with its mornings."""
    network = Path(forecaster) if Path(forecaster).suffix else CHECKPOINTS / f"{forecaster}.onnx"
    weights = digest(network) if network.is_file() else ""
    decides = {"settings": facts.settings, "sources": facts.sha256, "weights": weights, "versions": dict(versions)}
    given = PlannerSettings(**facts.settings)
    learned = {"buffer": (given.design, buffer.CHECKPOINT), "set_points": (given.set_points, acc.CHECKPOINT)}
    # Only what is used: all other folders keep their names.
    decides |= {part: digest(path) for part, (chosen, path) in learned.items() if chosen == "learned"}
    return out / "runs" / content_hash(decides)[:16]


@lru_cache(maxsize=1)
def _sources() -> str:
    """SHA-256 of all code that a morning runs."""
    return hashlib.sha256(b"".join(path.read_bytes() for path in source_files(Arm))).hexdigest()


def _drive(
    folder: Path, arm: str, seeds: Sequence[int], work: Work, workers: int, progress: Callable[[int], None]
) -> None:
    """Drives what is missing, each run in a process of its own, since SUMO is global in one."""
    cells = [Cell(arm, None, *morning_place(seed)) for seed in seeds]
    there = {cell_of(row) for row in read_rows(folder / ROWS) if "lost" not in row}
    progress(sum(cell in there for cell in cells))
    run(folder / ROWS, cells, work, workers=workers, fresh=True, progress=lambda done, total, job: progress(done))
    if lost := [row["lost"] for row in read_rows(folder / ROWS) if "lost" in row and cell_of(row) in cells]:
        raise SimulationError(lost[0])


def _told(progress: Progress, before: int, total: int, done: int) -> None:
    progress(before + done, total, 0.0)


def _units(folder: Path, arm: str, seeds: Sequence[int]) -> Units:
    rows = {cell_of(row): row for row in read_rows(folder / ROWS)}
    return {
        f"seed-{seed:03}": {
            metric.key: round(float(rows[Cell(arm, None, *morning_place(seed))][metric.key]), 6) for metric in METRICS
        }
        for seed in seeds
    }
