"""Faults of benchmark files: each in one line, at a place that the file has, in words of its author."""

from __future__ import annotations

from pathlib import Path

import pytest

from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.sumo_networks.errors import InvalidInputError

SHORT = """
name = "mine"
description = "d"
headline = "driving_score"
metric = "m"
network = "ingolstadt"
seeds = [0, 1]
conditions = ["clear"]

[traffic]
vehicles = 3

[[missions]]
name = "one"
start = { lane = "a_0" }
goal = { lane = "b_0" }
events = [{ kind = "lead_vehicle_brakes", name = "brakes", at_m = 50 }]
"""
LONG = """
name = "mine"
description = "d"
headline = "driving_score"
metric = "m"
cells = [{ name = "town", network = "ingolstadt", missions = "some", traffic = { vehicles = 3 } }]

[[missions.some]]
name = "one"
start = { lane = "a_0" }
goal = { lane = "b_0" }
"""


def refusal(text: str, folder: Path) -> str:
    path = folder / "mine.toml"
    path.write_text(text)
    with pytest.raises(InvalidInputError) as refused:
        load_benchmark(str(path))
    before, _, told = str(refused.value).partition(f"benchmark file '{path}': ")
    assert before == ""
    assert "\n" not in told
    return told


@pytest.mark.parametrize(
    ("wrong", "right", "told"),
    [
        ("vehicle = 3", "vehicles = 3", "traffic.vehicle: unknown key; did you mean 'vehicles'? (there is "),
        ("[trafic]", "[traffic]", "trafic: unknown key; did you mean 'traffic'? (there is cells, conditions, "),
        ("{ line = ", "{ lane = ", "missions.0.start.line: unknown key; did you mean 'lane'? (there is lane, position"),
        ('nam = "brakes"', 'name = "brakes"', "missions.0.events.0.nam: unknown key; did you mean 'name'? (there is "),
        ("deceleration = 3", 'name = "brakes"', "missions.0.events.0.deceleration: unknown key; did you mean 'decele"),
        ("via = []", 'goal = { lane = "b_0" }', "missions.0.goal: expected a value, and there is none"),
        ('conditions = "snow"', 'conditions = ["clear"]', "conditions: expected a list, got 'snow'"),
        ('name = "my bench"', 'name = "mine"', "name: expected up to 100 letters, digits, '_', '.' and '-' that begin"),
        ("seeds = [0, 1, 0]", "seeds = [0, 1]", "seeds: expected every seed once, got 0 again"),
        ("seeds = []", "seeds = [0, 1]", "seeds: expected a list with 1 or more entries, got []"),
        ('kind = "lead"', 'kind = "lead_vehicle_brakes"', "missions.0.events.0: expected 'kind' to be one of "),
        ('vehicles = "three"', "vehicles = 3", "traffic.vehicles: expected a whole number, got 'three'"),
        ("vehicles = -3", "vehicles = 3", "traffic.vehicles: expected at least 0, got -3"),
    ],
)
def test_a_fault_is_told_in_words_at_its_place_in_a_short_file(
    wrong: str, right: str, told: str, tmp_path: Path
) -> None:
    assert right in SHORT
    assert refusal(SHORT.replace(right, wrong, 1), tmp_path).startswith(told)


@pytest.mark.parametrize(
    ("wrong", "right", "told"),
    [
        ("{ vehicle = 3", "{ vehicles = 3", "cells.0.traffic.vehicle: unknown key; did you mean 'vehicles'? (there is"),
        ("via = []", 'goal = { lane = "b_0" }', "missions.some.0.goal: expected a value, and there is none"),
        ('missions = "any"', 'missions = "some"', "cell 'town': no set of missions 'any'"),
        ('metric = "m"\ntraffic = {}', 'metric = "m"', "traffic: unknown key (there is cells, description, "),
    ],
)
def test_and_in_a_file_with_cells(wrong: str, right: str, told: str, tmp_path: Path) -> None:
    assert right in LONG
    assert refusal(LONG.replace(right, wrong, 1), tmp_path).startswith(told)


def test_without_a_fault_both_are_benchmarks(tmp_path: Path) -> None:
    for text in (SHORT, LONG):
        (tmp_path / "mine.toml").write_text(text)
        assert load_benchmark(str(tmp_path / "mine.toml")).name == "mine"
