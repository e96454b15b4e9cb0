"""What a table holds beside speeds: other quantities are refused or told, and the columns that were taken are named."""

from __future__ import annotations

import re
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from dohyo.agents.forecasting.data.reading import Format, read_data, read_latest
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.errors import InvalidInputError
from tests.agents.forecasting.roads import road_speeds

KMH = 3.6 * road_speeds(300, 1)[:, 0]
FLOW = 40.0 + 30.0 * np.sin(np.arange(300) / 40.0)


def table(path: Path, **columns: FloatArray) -> Path:
    """A CSV file with a row every five minutes."""
    times = [datetime(2026, 3, 2) + timedelta(minutes=5 * row) for row in range(len(next(iter(columns.values()))))]
    pl.DataFrame({"time": times, **columns}).write_csv(path)
    return path


@pytest.mark.parametrize(
    "name", ["flow", "Flow (veh/h)", "det7_occupancy", "OCC [%]", "vehicleCount", "Lane 1 Flow (Veh/5 Minutes)"]
)
def test_a_column_named_as_another_quantity_is_no_segment(tmp_path: Path, name: str) -> None:
    path = table(tmp_path / "t.csv", **{"speed": KMH, name: FLOW})
    for read in (read_data, read_latest):
        with pytest.raises(InvalidInputError, match=rf"got '{re.escape(name)}' \(1 of 2 columns .*--trust-unit"):
            read(path, Format("km/h"))
    assert read_data(path, Format("km/h", trust_unit=True)).segments == ("speed", name)


@pytest.mark.parametrize("name", ["Flow Road", "lane", "Count Street 5"])
def test_a_name_that_may_be_that_of_a_place_is_told(tmp_path: Path, name: str) -> None:
    notes = read_latest(table(tmp_path / "t.csv", **{"speed": KMH, name: KMH}), Format("km/h")).notes
    assert [note for note in notes if note == f"no speeds by their names, but read as such: {name}"]


@pytest.mark.parametrize("name", ["lane 1", "Lane 2 speed", "free-flow speed", "Occident", "Fleet Street", "volvo"])
def test_other_names_are_no_reason_to_ask(tmp_path: Path, name: str) -> None:
    notes = read_latest(table(tmp_path / "t.csv", **{"a": KMH, name: KMH}), Format("km/h")).notes
    assert not [note for note in notes if "name" in note]


def test_a_column_that_is_slow_all_the_time_is_told(tmp_path: Path) -> None:
    """It may be congested all the time, so it is no error."""
    path = table(tmp_path / "t.csv", a=KMH, x=FLOW / 500.0)
    notes = read_data(path, Format("km/h")).notes
    assert [note for note in notes if "'x'" in note and "expected 18 km/h or more" in note]
    trusted = read_data(path, Format("km/h", trust_unit=True)).notes
    assert not [note for note in trusted if "expected 18 km/h" in note]


def test_the_columns_that_were_taken_are_named(tmp_path: Path) -> None:
    few = read_data(table(tmp_path / "few.csv", a=KMH, b=KMH), Format("km/h")).notes
    assert few == ("2 columns are segments: a, b",)
    many = read_data(table(tmp_path / "many.csv", **{f"s{i}": KMH for i in range(30)}), Format("km/h")).notes
    assert many == ("30 columns are segments: s0, s1, s2, ..., s29",)


def code_notes(paths: Path | list[Path], missing_value: float | None = None) -> list[str]:
    notes = read_latest(paths, Format("km/h", missing_value=missing_value)).notes
    return [note for note in notes if "--missing-value" in note]


def with_code(value: float, share: float, speeds: FloatArray = KMH) -> FloatArray:
    return np.where(np.random.default_rng(0).random(len(speeds)) < share, value, speeds)


@pytest.mark.parametrize(("value", "share"), [(255.0, 0.03), (999.0, 0.01), (1023.75, 0.02), (0.0, 0.1), (0.0, 0.4)])
@pytest.mark.parametrize("decimals", [0, 2])
def test_a_number_that_stands_for_no_data_is_told(tmp_path: Path, value: float, share: float, decimals: int) -> None:
    road = with_code(value, share, 100.0 + np.random.default_rng(1).normal(0.0, 4.0, 300))
    path = table(tmp_path / "t.csv", a=np.where(road == value, value, road.round(decimals)), b=KMH)
    (note,) = code_notes(path)
    assert note.startswith(f"{(road == value).sum()} values are exactly {value:g} km/h")
    assert "'a'" in note
    assert note.endswith(f"--missing-value {value:g}")
    assert not code_notes(path, missing_value=value)


def test_one_number_in_many_columns_is_one_note(tmp_path: Path) -> None:
    path = table(
        tmp_path / "t.csv", **{f"s{i}": with_code(0.0, 0.1, np.full(300, 90.0) + FLOW / 10) for i in range(20)}
    )
    (note,) = code_notes(path)
    assert "(20 of 20 columns, such as 's0')" in note


def test_single_impossible_speeds_are_told(tmp_path: Path) -> None:
    rows = np.arange(300)
    (note,) = code_notes(table(tmp_path / "t.csv", a=np.where(rows % 100 == 50, 300.0 + rows, KMH)))
    assert note.startswith("3 values are above 250 km/h, up to 550 km/h")


def test_jams_rough_numbers_and_noise_are_no_such_numbers(tmp_path: Path) -> None:
    random, rows = np.random.default_rng(0), np.arange(3000)
    roads = {
        "jam": np.where((rows // 100) % 5 == 4, 0.0, 100.0),
        "stop and go": np.maximum(0.0, 30.0 + 40.0 * np.sin(rows / 5.0)).round(),
        "noise": random.uniform(20.0, 120.0, 3000).round(),
        "rough": random.normal(60.0, 25.0, 3000).clip(0.0, 150.0).round(),
        "tens": (random.normal(90.0, 20.0, 3000).clip(0.0, 150.0) / 10.0).round() * 10.0,
        "limited": np.minimum(random.normal(110.0, 10.0, 3000), 120.0),
    }
    assert not code_notes(table(tmp_path / "t.csv", **roads))
