"""Curves of trainings: a panel per task, a line per arm."""

from __future__ import annotations

from types import MappingProxyType

import numpy as np
import pytest

from dohyo.agents.studies import curves
from dohyo.agents.studies.training_results import TrainingRun
from dohyo.sumo_networks.errors import InvalidInputError

TOLD = {"ghrl": "rules imitated", "ghrl-r": "rules", "hrl": "PPO alone", "p-5": "5 %", "p-10": "10 %", "p-20": "20 %"}
HALF = 4.302653 * 10.0 / 3**0.5
"""Of Student's interval of three values 10 apart."""


def a_run(seed: int, *returns: float, imitated: int = 4000) -> TrainingRun:
    """Evaluated every 4000 steps."""
    values = np.array(returns)
    columns = {"steps": 4000.0 * np.arange(1, len(values) + 1), "episodes": np.full(len(values), 20.0)}
    columns |= {"return": values, "return_low": values - 5.0, "return_high": values + 7.0}
    return TrainingRun(seed, imitated, MappingProxyType(columns))


THREE = [a_run(0, 50.0, 90.0), a_run(1, 50.0, 100.0), a_run(2, 50.0, 110.0)]
ONE = [a_run(0, 20.0, 30.0, imitated=0)]


def named(drawn, mode="lines+markers"):
    return [trace for trace in drawn.data if trace.mode == mode and trace.x[0] is not None]


def test_an_arm_of_seeds_has_a_line_in_a_band_and_one_of_a_single_seed_has_whiskers():
    drawn = curves.draw({"lane": {"ghrl": THREE, "hrl": ONE}}, TOLD)
    many, single = named(drawn)
    assert many.x.tolist() == [4.0, 8.0]
    assert many.y.tolist() == [50.0, 100.0]
    (band,) = [trace for trace in drawn.data if trace.fill == "toself"]
    assert list(band.x) == [4.0, 8.0, 8.0, 4.0]
    assert list(band.y) == pytest.approx([57.0, 100.0 + HALF, 100.0 - HALF, 45.0])
    assert single.error_y.array.tolist() == [7.0, 7.0]
    assert single.error_y.arrayminus.tolist() == [5.0, 5.0]
    assert many.error_y.array is None


def test_arms_differ_by_more_than_colour_and_keep_their_look_whoever_else_is_there():
    everyone = dict.fromkeys(("ghrl", "ghrl-r", "hrl", "p-5", "p-10", "p-20"), ONE)
    looks = [(one.line.color, one.line.dash, one.marker.symbol) for one in named(curves.draw({"lane": everyone}, TOLD))]
    for part in zip(*looks, strict=True):
        assert len(set(part)) == 6
    (alone,) = named(curves.draw({"lights": {"p-5": ONE}}, TOLD))
    assert (alone.line.color, alone.line.dash, alone.marker.symbol) == looks[3]


def test_the_legend_names_each_arm_once_and_how_many_seeds_it_has():
    drawn = curves.draw({"lane": {"ghrl": THREE, "other": ONE}, "master": {"ghrl": ONE}}, TOLD)
    keys = [trace.name for trace in drawn.data if trace.showlegend is not False]
    assert keys == ["ghrl (rules imitated), 1 to 3 seeds", "other, 1 seed"]


def test_imitation_is_grey_where_any_arm_imitates():
    drawn = curves.draw({"lane": {"ghrl": THREE, "hrl": ONE}, "master": {"hrl": ONE}}, TOLD)
    (grey,) = drawn.layout.shapes
    assert (grey.x0, grey.x1) == (0, 4.0)


def test_the_title_says_who_ends_highest_and_where_intervals_are_apart():
    both = {"ghrl": THREE, "hrl": ONE}
    near = {"ghrl": [a_run(0, 28.0)], "hrl": [a_run(0, 30.0)]}
    tied = {"ghrl": ONE, "hrl": ONE}
    results = {"lane": both, "left": both, "right": near, "lights": tied, "master": {"hrl": ONE}}
    title = curves.finding(results, "return")
    assert title == "Highest return at the end, of 4 tasks: ghrl in 2, hrl in 1, nobody in 1; intervals apart in 2"
    alone = curves.finding({"lane": {"ghrl": THREE}, "master": {"hrl": ONE}}, "return")
    assert alone == "Held-out return at the end: lane 100, master 30.0"


def test_a_measure_that_runs_do_not_have_is_named():
    with pytest.raises(InvalidInputError, match="expected evaluations with a column 'success'"):
        curves.draw({"lane": {"ghrl": ONE}}, TOLD, "success")
