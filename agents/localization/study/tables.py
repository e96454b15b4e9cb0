"""Tables and figure of the study.

python -m dohyo.agents.localization.study.tables agents/localization/results/study.json --results --figure study.html
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from dohyo.agents.localization.study.figures import grid_figure, page
from dohyo.agents.studies.tables import PAGE, bracketed, write_section
from dohyo.evaluation.report.style import markdown as markdown_table
from dohyo.evaluation.report.style import number
from dohyo.evaluation.statistics import Estimate
from dohyo.sumo_networks.files import write_atomically

ARMS = ("none", "calibrated", "calibrated + low-pass")
NAMES = {"es-ekf": "ES-EKF", "ekf": "EKF", "ukf": "UKF", "imu": "IMU only"}
Cells = Sequence[Mapping[str, Any]]


def main() -> None:
    """Prints the tables; writes RESULTS.md and the figure on request."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("study", type=Path, help="the stored results")
    parser.add_argument("--results", action="store_true", help="write the tables into RESULTS.md")
    parser.add_argument("--figure", type=Path)
    arguments = parser.parse_args()
    result = json.loads(arguments.study.read_text())
    print(markdown(result))
    if arguments.results:
        write_section(Path(__file__).parents[1].joinpath(PAGE), "study", markdown(result))
    if arguments.figure:
        text = page("Localization study", [grid_figure(result["cells"])], {})
        write_atomically(arguments.figure, text.encode())


def markdown(result: Mapping[str, Any]) -> str:
    """All tables, with a blank line between them."""
    cells = result["cells"]
    parts = [accuracy_by_rate(cells, 0.1, 0.5), rmse_by_sigma(cells), by_filter(cells, 0.3), white(cells)]
    return "\n\n".join([*parts, vibration(cells), against(result["es_ekf_against"])])


def accuracy_by_rate(cells: Cells, *sigmas: float) -> str:
    """Arms by rate, ES-EKF."""
    rates = _values(cells, "rate_hz")
    rows = []
    for arm in ARMS:
        for sigma in sigmas:
            chosen = [_one(cells, arm=arm, filter="es-ekf", rate_hz=rate, sigma_m=sigma) for rate in rates]
            rows.append([arm, f"{sigma:g}", *(_interval(cell["accuracy"]) for cell in chosen)])
    return markdown_table(["within 0.5 m, %: ES-EKF", "sigma, m", *(f"{rate:g} Hz" for rate in rates)], rows)


def by_sigma(cells: Cells, name: str) -> tuple[list[str], list[list[str]]]:
    """Head and rows of the benchmark's table for one filter: accuracy and RMSE by sigma and arm over the rate."""
    rates = list(dict.fromkeys(cell["rate_hz"] for cell in cells if cell["filter"] == name))
    rows = []
    for arm in ARMS:
        for sigma in dict.fromkeys(cell["sigma_m"] for cell in cells if cell["filter"] == name):
            chosen = [_one(cells, arm=arm, filter=name, rate_hz=rate, sigma_m=sigma) for rate in rates]
            rows.append([f"{sigma:g}", arm, *(f"{_mean(c, 'accuracy')} / {_mean(c, 'rmse')}" for c in chosen)])
    for arm in ARMS:
        alone = _one(cells, arm=arm, filter="imu")
        rows.append(["-", f"{arm}, {NAMES['imu']}", f"{_mean(alone, 'accuracy')} / {_mean(alone, 'rmse')}"])
        rows[-1] += [""] * (len(rates) - 1)
    rows.sort(key=lambda row: float(row[0]) if row[0] != "-" else float("inf"))
    return ["sigma, m", f"{NAMES[name]}", *(f"{rate:g} Hz" for rate in rates)], rows


def rmse_by_sigma(cells: Cells) -> str:
    """Accuracy and RMSE over sigma and rate, calibrated ES-EKF."""
    rates, rows = _values(cells, "rate_hz"), []
    for sigma in _values(cells, "sigma_m"):
        chosen = [_one(cells, arm="calibrated", filter="es-ekf", rate_hz=rate, sigma_m=sigma) for rate in rates]
        rows.append([f"{sigma:g}", *(f"{_mean(c, 'accuracy')} / {_mean(c, 'rmse')}" for c in chosen)])
    return markdown_table(["calibrated ES-EKF: %, RMSE in m; sigma, m", *(f"{rate:g} Hz" for rate in rates)], rows)


def by_filter(cells: Cells, sigma: float) -> str:
    """All filters side by side, calibrated."""
    rows = [
        [f"{rate:g}", NAMES[name], *_scores(_one(cells, filter=name, rate_hz=rate, sigma_m=sigma))]
        for rate in _values(cells, "rate_hz")
        for name in ("es-ekf", "ekf", "ukf")
    ]
    rows.append(["none", NAMES["imu"], *_scores(_one(cells, filter="imu", sigma_m=sigma))])
    head = [
        "rate, Hz",
        f"sigma {sigma:g} m, calibrated",
        "within 0.5 m, %",
        "RMSE, m",
        "95 % within, m",
        "max drift, m",
    ]
    return markdown_table([*head, "NEES (2)", "NIS (3)", "us per step"], rows)


def white(cells: Cells) -> str:
    """The same receiver with purely white errors."""
    rates, rows = _values(cells, "rate_hz"), []
    for sigma in _values(cells, "sigma_m"):
        chosen = [
            _one(cells, filter="es-ekf", rate_hz=rate, sigma_m=sigma, correlated_share=0.0, vibration=0.0)
            for rate in rates
        ]
        rows.append([f"{sigma:g}", *(f"{_mean(c, 'accuracy')} / {_mean(c, 'nees')}" for c in chosen)])
    return markdown_table(["white errors only: %, NEES (2); sigma, m", *(f"{rate:g} Hz" for rate in rates)], rows)


def vibration(cells: Cells) -> str:
    """Effect of the low-pass filter with vibration."""
    rates, rows = _values(cells, "rate_hz"), []
    for shaken in (0.0, 0.5):
        for arm in ARMS[1:]:
            chosen = [
                _one(cells, arm=arm, filter="es-ekf", rate_hz=rate, sigma_m=0.1, vibration=shaken) for rate in rates
            ]
            rows.append([f"{shaken:g}", arm, *(_interval(cell["rmse"]) for cell in chosen)])
    return markdown_table(["vibration, m/s^2", "RMSE in m, sigma 0.1 m", *(f"{rate:g} Hz" for rate in rates)], rows)


def against(comparisons: Cells) -> str:
    """In how many cells the ES-EKF's RMSE is significantly smaller, significantly larger, or neither."""
    rows = []
    for arm in ARMS:
        for other in ("ekf", "ukf"):
            chosen = [
                c for c in comparisons if c["arm"] == arm and c["filter"] == other and c["correlated_share"] > 0.0
            ]
            verdicts = Counter(cell["verdict"] for cell in chosen)
            counts = [str(verdicts[verdict]) for verdict in ("<", "=", ">")]
            rows.append([arm, NAMES[other], *counts, str(chosen[0]["difference_m"]["n"]) if chosen else "0"])
    head = ["ES-EKF's RMSE against", "", "smaller", "no difference found", "larger", "journeys each"]
    return markdown_table(head, rows)


def _one(cells: Cells, **wanted: Any) -> Mapping[str, Any]:
    """Cell with the wanted values; by default calibrated, with half of the fixes' variance correlated."""
    asked = {"arm": "calibrated", "correlated_share": 0.5, "vibration": 0.0} | wanted
    return next(cell for cell in cells if all(cell[key] == value for key, value in asked.items()))


def _values(cells: Cells, key: str) -> list[float]:
    return list(dict.fromkeys(cell[key] for cell in cells))


def _scores(cell: Mapping[str, Any]) -> list[str]:
    shown = [_interval(cell[name]) for name in ("accuracy", "rmse", "p95", "max_drift")]
    return [*shown, *(_mean(cell, name) for name in ("nees", "nis", "step_us"))]


def _interval(estimate: Mapping[str, Any]) -> str:
    return bracketed(Estimate(**estimate))


def _mean(cell: Mapping[str, Any], name: str) -> str:
    mean = cell[name]["mean"]
    return "-" if mean is None else number(mean)


if __name__ == "__main__":
    main()
