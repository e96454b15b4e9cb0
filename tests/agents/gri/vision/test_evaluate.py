"""Evaluation of A-VIS: measures of hand-made answers, and the page says what is stored."""

from __future__ import annotations

import json

import numpy as np
import pytest

from dohyo.agents.gri.vision.evaluate import STORED, Answers, constant_answers, judged
from dohyo.agents.gri.vision.recording import JUDGED
from dohyo.agents.gri.vision.tables import PAGE, SECTION, TITLES, table

TRUE = Answers(
    junction=np.array([1, 0, 0, 0]),
    lit=np.array([1, 1, 0, 0]),
    colour=np.array([2, 0, 0, 0]),
    distance_m=np.array([10.0, 30.0, 0.0, 0.0]),
    angle_rad=np.array([0.1, -0.1, 0.0, 0.0]),
    offset_m=np.array([0.5, 0.5, 0.5, 0.9]),
)


def test_heads_are_judged_against_constant_answers_and_lights_where_there_is_one():
    constant = constant_answers(TRUE)
    numbers = {"distance_m": 20.0, "angle_rad": pytest.approx(0.0), "offset_m": 0.5}
    assert constant == {"junction": 0, "lit": 0, "colour": 0, **numbers}
    told = TRUE._replace(junction=np.array([1, 1, 0, 0]), distance_m=np.array([12.0, 30.0, 40.0, 40.0]))
    found = judged(told, TRUE, constant, np.array([0, 0, 1, 1]))
    assert found["junction"]["value"][0] == 0.75
    assert found["junction"]["constant"] == 0.75
    assert (found["colour"]["moments"], found["colour"]["value"][0], found["colour"]["constant"]) == (2, 1.0, 0.5)
    assert (found["distance_m"]["value"][0], found["distance_m"]["constant"]) == (1.0, 10.0)
    assert found["angle_rad"]["moments"] == 4
    assert found["angle_rad"]["constant"] == 0.05
    assert (found["offset_m"]["value"][0], found["offset_m"]["constant"]) == (0.0, pytest.approx(0.1))
    low, high = found["junction"]["value"][1:]
    assert (low, high) == (0.5, 1.0), "one drive is right in half of its moments, the other in all"


def test_the_constant_of_a_number_is_the_one_with_the_smallest_mean_error():
    skewed = {"distance_m": np.array([1.0, 2.0, 3.0, 40.0]), "angle_rad": np.array([0.0, 0.0, 0.0, 1.0])}
    constant = constant_answers(TRUE._replace(lit=np.ones(4, int), **skewed))
    assert (constant["distance_m"], constant["angle_rad"]) == (2.5, 0.0)


def test_without_a_light_colour_and_distance_are_not_judged():
    dark = TRUE._replace(lit=np.zeros(4, int))
    found = judged(dark, dark, constant_answers(TRUE), np.arange(4))
    assert found["colour"] is found["distance_m"] is None


def test_the_page_shows_what_is_stored():
    stored = json.loads(STORED.read_text())
    _, _, rest = PAGE.read_text().partition(f"<!-- begin {SECTION} -->")
    assert rest.partition(f"<!-- end {SECTION} -->")[0].strip() == table(stored).strip()
    assert set(TITLES) == set(stored["splits"]) == set(JUDGED)
