"""Curves of trainings, from what runs leave behind."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from agents.hierarchical import curves
from sumo_networks.errors import InvalidInputError

EVALUATED = [(4000, 20, 40.0, 22.0, 61.0), (8000, 20, 75.0, 53.0, 89.0)]


def written(folder: Path) -> Path:
    folder.mkdir(parents=True)
    (folder / "config.toml").write_text("steps = 8000\n[ppo]\nimitated_steps = 4000\n")
    with (folder / "evaluations.csv").open("w") as file:
        table = csv.writer(file)
        table.writerow(("steps", "episodes", "success", "success_low", "success_high"))
        table.writerows(EVALUATED)
    with (folder / "metrics.csv").open("w") as file:
        table = csv.writer(file)
        table.writerow(("steps", "success"))
        table.writerows((4000 + 100 * i, "" if i % 2 else 10.0 * i) for i in range(1, 21))
    return folder


def test_a_curve_holds_what_the_run_wrote(tmp_path):
    curve = curves.read_curve(written(tmp_path / "lane"))
    assert curve.steps.tolist() == [4000, 8000]
    assert curve.success[1].tolist() == [75.0, 53.0, 89.0]
    assert curve.imitated == 4000
    assert len(curve.trained) == 10
    assert curve.trained[0].tolist() == [4200.0, 20.0]


def test_a_panel_has_points_with_whiskers_and_a_mean_of_the_last_rounds(tmp_path):
    drawn = curves.draw({name: curves.read_curve(written(tmp_path / name)) for name in ("lane", "lights")})
    line, points, *_ = drawn.data
    assert points.y.tolist() == [40.0, 75.0]
    assert points.error_y.array.tolist() == [21.0, 14.0]
    assert points.error_y.arrayminus.tolist() == [18.0, 22.0]
    assert line.y[1] == pytest.approx(30.0)
    assert line.y[-1] == pytest.approx(sum(20.0 * i for i in range(3, 11)) / 8)
    assert drawn.layout.title.text == "Success at the end: lane 75 %, lights 75 %"


def test_what_is_no_run_is_named(tmp_path):
    with pytest.raises(InvalidInputError, match=r"'.*lane' is no run: .*config.toml"):
        curves.read_curve(tmp_path / "lane")
    folder = written(tmp_path / "left")
    (folder / "evaluations.csv").write_text("steps,episodes,success\n")
    with pytest.raises(InvalidInputError, match="has been evaluated"):
        curves.read_curve(folder)
    (tmp_path / "none").mkdir()
    with pytest.raises(InvalidInputError, match="expected runs named as one of lane"):
        curves.main([str(tmp_path / "none")])
