"""Small records of each family that has no drives on roads."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final

from dohyo.evaluation.families import FORECASTING_CONTROL, PARKING_CONTROL, PLANNING_CONTROL
from dohyo.evaluation.freeway.benchmark import load_forecasting, load_traffic
from dohyo.evaluation.freeway.day import METRICS, DayRecord, DaysManifest
from dohyo.evaluation.freeway.morning import MorningRecord, MorningScenario, MorningsManifest
from dohyo.evaluation.parking.benchmark import load_parking_benchmark
from dohyo.evaluation.parking.record import KartRecord, ParkingRecord
from dohyo.evaluation.records.record import AgentInfo
from dohyo.evaluation.running.manifest import MANIFEST, RECORDS, ResultManifest

Record = DayRecord | MorningRecord | ParkingRecord


def remote(control: str) -> AgentInfo:
    """An agent of a policy worker."""
    return AgentInfo(
        name="mine", kind="remote", entry="remote:mine", track="sensors", sensors=("seen",), control=control
    )


def day(failure: str | None = None) -> DayRecord:
    """A day of forecasts, or one on which the forecaster failed."""
    hard = load_forecasting("forecast-hard")
    measures = {} if failure else {one.key: 2.0 for one in METRICS}
    made = DayRecord(
        scenario=hard.scenarios()[0], benchmark=(hard.name, hard.sha256), agent=remote(FORECASTING_CONTROL),
        measures=measures, forecasts=430, forecasts_sha256="" if failure else "ab" * 32, versions={"dohyo": "1"},
        failure=failure, wall_s=1.5,
    )  # fmt: skip
    return made.sealed()


def morning(failure: str | None = None) -> MorningRecord:
    """A morning on the freeway, or one on which the planner failed."""
    dissipation = load_traffic("dissipation")
    outcome = {} if failure else {"speed_mps": 25.0, "throughput_vph": None}
    made = MorningRecord(
        scenario=MorningScenario(benchmark=dissipation, seed=3), benchmark=(dissipation.name, dissipation.sha256),
        agent=remote(PLANNING_CONTROL), outcome=outcome, plans=2, failure=failure, wall_s=1.5,
    )  # fmt: skip
    return made.sealed()


def lot(*failures: str) -> ParkingRecord:
    """A lot of three karts, of which the first ones failed and the others parked."""
    three = load_parking_benchmark("parking-three")
    endings = [*failures, *[None] * 3][:3]
    karts = [
        KartRecord(
            ending="parked" if failure is None else "failed", aligned=failure is None, time_s=9.5, inclination_deg=1.0,
            deviation_m=0.1, distance_m=0.1, driven_m=12.0, shunts=1, touched="nothing", failure=failure,
        )
        for failure in endings
    ]  # fmt: skip
    made = ParkingRecord(
        benchmark=three, seed=5, agent=remote(PARKING_CONTROL), version="1", karts=tuple(karts), motion_sha256="cd" * 32
    )
    return made.sealed()


MANIFESTS: Final[Mapping[type[Record], type[ResultManifest]]] = {
    DayRecord: DaysManifest,
    MorningRecord: MorningsManifest,
}


def fetched(folder: Path, record: DayRecord | MorningRecord) -> Path:
    """Writes a result folder with one record, as `dohyo evaluations fetch` does; returns the record's path."""
    benchmark = record.scenario.benchmark
    record.write(folder / RECORDS, record.scenario.name)
    manifest = MANIFESTS[type(record)](agent=record.agent, benchmark=benchmark, benchmark_sha256=benchmark.sha256)
    (folder / MANIFEST).write_text(manifest.model_dump_json())
    return folder / RECORDS / f"{record.scenario.name}.json"
