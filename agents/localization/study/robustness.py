"""Study of robustness: journeys that begin rolling, with vibration, outages and wild fixes.

    python -m dohyo.agents.localization.study.robustness --seeds 5

A seed draws the errors on each of three routes anew; all arms see the same errors. A receiver has a fix a second, is
silent for so long as the case says after every 20 s, and 5 % of its fixes lie 20 to 200 m away. The IMU's offsets are
not calibrated, since the vehicle never stands. The reference is the same filter without the wild fixes, with the noise
told. Rows are kept in results/robustness.jsonl, and those that exist are not run again; the tables go into RESULTS.md.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from dohyo.agents.localization.diagnosis import diagnose
from dohyo.agents.localization.filters.base import FilterNoise
from dohyo.agents.localization.localizer import Fix, Localizer
from dohyo.agents.localization.settings import Settings
from dohyo.agents.localization.study.grid import score
from dohyo.agents.localization.study.synthetic import ROUTES, Journey, errors_of, journey_named, record
from dohyo.agents.localization.track import follow, smooth
from dohyo.agents.studies.tables import PAGE, bracketed, write_section
from dohyo.evaluation.report.style import markdown
from dohyo.evaluation.statistics import mean_estimate
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.errors import DohyoError
from dohyo.sumo_networks.files import write_atomically
from dohyo.sumo_networks.sensors.gnss import GnssNoise
from dohyo.sumo_networks.sensors.imu import ICM_20600

ROWS = Path(__file__).parents[1] / "results" / "robustness.jsonl"
BEGIN_S, LENGTH_S, OPEN_S = 15.0, 180.0, 20.0
WILD_SHARE, WILD_M = 0.05, (20.0, 200.0)
VIBRATION = 0.5
OUTAGES_S = (0.0, 5.0, 20.0, 50.0)
SIGMAS_M = (0.5, 2.5)
UNSMOOTHED = ("gate", "none")
ARMS = ("reference", "robust", "robust, noise not told", "gate", "none")


@dataclass(frozen=True, slots=True)
class Case:
    """One journey of one arm.

    Attributes:
        arm: A name of `ARMS`.
        outage_s: Silence of the receiver after every 20 s with fixes.
        sigma_m: Of the fixes' error.
        route: A name of `synthetic.ROUTES`.
        seed: Of all errors.
    """

    arm: str
    outage_s: float
    sigma_m: float
    route: str
    seed: int


def cases(seeds: range) -> Iterator[Case]:
    """All cases, seed by seed."""
    for seed, sigma, outage, route, arm in product(seeds, SIGMAS_M, OUTAGES_S, ROUTES, ARMS):
        yield Case(arm, outage, sigma, route, seed)


def settings_of(case: Case) -> Settings:
    """Settings of a case's arm."""
    told = FilterNoise.of(replace(ICM_20600, vibration=VIBRATION))
    settings = Settings(start="rolling", gnss_sigma_m=case.sigma_m, noise=told, alpha=0.0)
    if case.arm == "robust, noise not told":
        return settings.model_copy(update={"noise": Settings().noise})
    if case.arm in ("gate", "none"):
        return settings.model_copy(update={"outliers": case.arm})
    return settings


@cache
def rolling_journey(route: str) -> Journey:
    """A journey without its start."""
    whole = journey_named(route, seconds=LENGTH_S)
    first = int(np.searchsorted(whole.time, BEGIN_S))
    arrays = ("time", "position", "velocity", "heading", "imu", "moving")
    return replace(whole, **{name: getattr(whole, name)[first:] for name in arrays})


def fixes_of(
    case: Case, journey: Journey, rows: FloatArray, positions: FloatArray, rng: np.random.Generator
) -> list[Fix]:
    """Fixes outside of the outages; in all arms but the reference, some are wild."""
    out = []
    for row, position in zip(rows.astype(int), positions, strict=True):
        wild, distance, angle = rng.random() < WILD_SHARE, rng.uniform(*WILD_M), rng.uniform(0.0, 2.0 * math.pi)
        time = float(journey.time[row])
        if (time - BEGIN_S) % (OPEN_S + case.outage_s) > OPEN_S:
            continue
        if wild and case.arm == "reference":
            continue
        away = distance * np.array([math.cos(angle), math.sin(angle), 0.0]) if wild else 0.0
        out.append(Fix(time, position + away))
    return out


def run(case: Case) -> dict[str, Any]:
    """Scores of a case: those of the filter, RMSE and NEES of the smoother, and whether a warning came."""
    journey = rolling_journey(case.route)
    gnss = GnssNoise(case.sigma_m, correlated_share=0.0, rate_hz=1.0)
    imu = replace(ICM_20600, vibration=VIBRATION)
    recording = record(journey, imu, gnss, errors_of(case.route, case.seed))
    wild = errors_of(case.route, case.seed, part=1)
    fixes = fixes_of(case, journey, recording.fix_rows, recording.fixes, wild)
    localizer, smoothed = Localizer(settings_of(case)), case.arm not in UNSMOOTHED
    try:
        track = follow(localizer, journey.time, recording.imu, fixes)
        late = score(smooth(localizer, track, journey.time, recording.imu, fixes), journey) if smoothed else {}
    except DohyoError as error:
        return asdict(case) | {"failed": str(error)}
    got = score(track, journey)
    return asdict(case) | {
        **{name: _rounded(got[name]) for name in ("rmse", "p95", "max_drift", "nees", "nis")},
        **{f"smoothed_{name}": _rounded(late[name]) for name in ("rmse", "nees") if late},
        "rejected": track.rejected,
        "fixes": len(track.fixes),
        "warned": bool(diagnose(track, localizer.settings)),
    }


def _rounded(value: float) -> float:
    return float(f"{value:.5g}")


def tables(rows: Sequence[Mapping[str, Any]]) -> str:
    """RMSE and NEES by arm over the length of the outages."""
    parts = []
    for metric, title in (
        ("rmse", "RMSE of the filter, m"),
        ("smoothed_rmse", "RMSE of the smoother, m"),
        ("nees", "NEES of the filter (2)"),
        ("smoothed_nees", "NEES of the smoother (2)"),
    ):
        body = []
        for sigma, arm in product(SIGMAS_M, ARMS):
            chosen = [_of(rows, arm, sigma, outage, metric) for outage in OUTAGES_S]
            body.append(
                [f"{sigma:g}", arm, *(bracketed(mean_estimate(values)) if values else "-" for values in chosen)]
            )
        parts.append(markdown([title + "; sigma, m", "arm", *(f"{outage:g} s" for outage in OUTAGES_S)], body))
    return "\n\n".join([*parts, against_reference(rows)])


def against_reference(rows: Sequence[Mapping[str, Any]]) -> str:
    """RMSE of a cell in units of the reference's, the share of journeys with a warning, and those that diverged."""
    body = []
    for sigma, arm in product(SIGMAS_M, ARMS[1:]):
        cells = []
        for outage in OUTAGES_S:
            ours, known = (_of(rows, name, sigma, outage, "rmse") for name in (arm, "reference"))
            warned = _of(rows, arm, sigma, outage, "warned")
            ratio = f"{np.mean(ours) / np.mean(known):.2f}" if ours and known else "-"
            diverged = len(_of(rows, arm, sigma, outage, "failed"))
            told = f"{ratio} / {100.0 * float(np.mean(warned)):.0f} %" if warned else "-"
            cells.append(f"{told} / {diverged}" if diverged else told)
        body.append([f"{sigma:g}", arm, *cells])
    head = ["mean RMSE over the reference's / journeys with a warning / journeys diverged; sigma, m", "arm"]
    return markdown([*head, *(f"{outage:g} s" for outage in OUTAGES_S)], body)


def _of(rows: Sequence[Mapping[str, Any]], arm: str, sigma: float, outage: float, metric: str) -> list[Any]:
    return [
        row[metric]
        for row in rows
        if row["arm"] == arm and row["sigma_m"] == sigma and row["outage_s"] == outage and metric in row
    ]


def main() -> None:
    """Runs what is missing, keeps the rows, and writes the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--rows", type=Path, default=ROWS)
    parser.add_argument("--results", type=Path, default=Path(__file__).parents[1] / PAGE)
    arguments = parser.parse_args()
    rows = [json.loads(line) for line in arguments.rows.read_text().splitlines()] if arguments.rows.exists() else []
    known = {tuple(row[name] for name in Case.__slots__) for row in rows}
    for case in cases(range(arguments.seeds)):
        if tuple(getattr(case, name) for name in Case.__slots__) not in known:
            rows.append(run(case))
            write_atomically(arguments.rows, ("\n".join(map(json.dumps, rows)) + "\n").encode())
    write_section(arguments.results, "robustness", tables(rows))


if __name__ == "__main__":
    main()
