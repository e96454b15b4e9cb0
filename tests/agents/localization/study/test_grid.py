"""The benchmark `localization`: what it runs, what it prints, and that its numbers go the way they must."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from dohyo.agents.localization.study import grid as study
from dohyo.agents.localization.study.grid import ARMS, RATES_HZ, SIGMAS_M, Cell, grid
from dohyo.agents.localization.study.synthetic import ROUTES
from dohyo.agents.localization.study.tables import by_sigma, markdown
from dohyo.service.cli import app
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two rates, two errors, one route, 40 s."""
    monkeypatch.setattr(study, "RATES_HZ", (10.0, 0.2))
    monkeypatch.setattr(study, "SIGMAS_M", (0.1, 2.5))
    monkeypatch.setattr(study, "LENGTH_S", 40.0)
    monkeypatch.setattr(study, "ROUTES", {name: ROUTES[name] for name in list(ROUTES)[:1]})
    study._journey.cache_clear()


def test_the_grid_is_every_arm_filter_rate_and_error_and_the_imu_alone() -> None:
    cells = list(grid(("es-ekf", "ekf", "ukf")))
    assert len(cells) == len(set(cells)) == 3 * 3 * 4 * 5 + 3
    assert {cell.arm for cell in cells} == set(ARMS)
    assert {cell.rate_hz for cell in cells} == set(RATES_HZ) == {10.0, 1.0, 0.2, 0.05}
    assert {cell.sigma_m for cell in cells} == set(SIGMAS_M) == {0.1, 0.3, 0.5, 1.0, 2.5}
    assert {cell.filter for cell in cells} == {"es-ekf", "ekf", "ukf", "imu"}
    assert Cell("calibrated", "ukf", 0.05, 2.5) in cells


@pytest.mark.usefixtures("small")
def test_one_command_prints_a_table_by_sigma_and_writes_all_metrics(tmp_path: Path) -> None:
    out = tmp_path / "results" / "study.json"
    done = CliRunner().invoke(app, ["localize", "--study", "--seeds", "1", "--out", str(out)])
    assert done.exit_code == 0, done.output
    result = json.loads(out.read_text())
    assert len(result["cells"]) == 3 * 2 * 2 + 3
    assert set(study.METRICS) <= set(result["cells"][0])
    head, rows = by_sigma(result["cells"], "es-ekf")
    assert head == ["sigma, m", "ES-EKF", "10 Hz", "0.2 Hz"]
    assert [row[0] for row in rows] == ["0.1"] * 3 + ["2.5"] * 3 + ["-"] * 3
    for cell in head:
        assert cell in done.output
    within = {(row[0], row[1]): [float(cell.split(" / ")[0]) for cell in row[2:] if cell] for row in rows}
    assert within["0.1", "calibrated"][0] > 95.0
    assert within["0.1", "calibrated"][0] > within["0.1", "none"][0] + 30.0, "calibration is far better than none"
    assert within["0.1", "calibrated"][0] > within["2.5", "calibrated"][0] + 30.0
    assert within["-", "calibrated, IMU only"][0] < within["0.1", "calibrated"][1]


@pytest.mark.usefixtures("small")
def test_the_same_seeds_give_the_same_document() -> None:
    first, second = (CliRunner().invoke(app, ["localize", "--study", "--json"]) for _ in range(2))
    documents = [json.loads(one.stdout) for one in (first, second)]
    for document in documents:
        for cell in document["cells"]:
            del cell["step_us"]
    assert documents[0] == documents[1]


def test_neither_logs_nor_study_is_an_error_and_so_is_an_unknown_filter() -> None:
    for arguments, kind in (
        ([], InvalidInputError),
        (["--imu", "a.csv"], InvalidInputError),
        (["--study", "--filter", "ekfs"], UnknownNameError),
    ):
        done = CliRunner().invoke(app, ["localize", *arguments])
        assert done.exit_code != 0
        assert isinstance(done.exception, kind)


def test_results_shows_the_stored_study() -> None:
    folder = Path(study.__file__).parents[1]
    stored = json.loads((folder / "results" / "study.json").read_text())
    found = re.search(r"<!-- begin study -->\n(.*?)\n<!-- end study -->", (folder / "RESULTS.md").read_text(), re.S)
    assert found
    assert found[1] == markdown(stored)


def test_the_benchmark_is_listed_with_its_command() -> None:
    done = CliRunner().invoke(app, ["benchmarks", "list"])
    assert "dohyo localize --study" in " ".join(done.output.split())
