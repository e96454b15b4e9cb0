"""Samples: every n-th scenario of some cells, one half of the missions, so many of each type."""

from __future__ import annotations

import pytest

from dohyo.agents.studies.arms import Cell
from dohyo.agents.studies.samples import Sample, places_of, scenario_of
from dohyo.evaluation.authoring.scenario_types import TYPES
from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.sumo_networks.errors import InvalidInputError


def names(sample: Sample) -> set[str]:
    return {one.name for one in sample.scenarios()}


def test_a_sample_takes_every_nth_scenario_of_the_cells_named() -> None:
    every = Sample("precrash", ("vehicle", "lead"), seed=1).scenarios()
    assert Sample("precrash", ("vehicle", "lead"), seed=1, every=3).scenarios() == every[::3]
    assert all(one.cell.startswith("lead") for one in every)
    assert {one.seed for one in every} == {1}
    with pytest.raises(InvalidInputError, match="'precrash' has no scenario in cells nowhere"):
        Sample("precrash", ("nowhere",)).scenarios()


def test_what_is_looked_at_and_what_is_held_out_are_apart_and_whole() -> None:
    look, held_out, every = (Sample("val14", remainder=half) for half in (1, 0, None))
    assert not names(look) & names(held_out)
    assert names(look) | names(held_out) == names(every)
    for part in (look, held_out):
        assert {name.partition(".")[0] for name in names(part)} == set(TYPES)


def test_so_many_of_each_type_are_a_part_of_more() -> None:
    few, more = (names(Sample("val14", remainder=0, per_type=count)) for count in (2, 3))
    assert len(few) == 2 * len(TYPES)
    assert few < more


def test_halves_need_numbered_missions() -> None:
    with pytest.raises(InvalidInputError, match="expected a numbered mission, such as m12"):
        Sample("quickstart", remainder=0).scenarios()


def test_the_scenario_of_a_cell_is_the_one_that_was_sampled() -> None:
    for sample in (Sample("obstacles", every=50, seed=3), Sample("val14", per_type=1)):
        cells = [Cell("arm", None, *place) for place in places_of([sample])]
        assert [scenario_of(cell) for cell in cells] == sample.scenarios()


def test_two_samples_follow_each_other() -> None:
    first, second = Sample("precrash", every=20), Sample("nocrash", every=100)
    assert places_of([first, second]) == [*first.places(), *second.places()]
    assert len(load_benchmark("precrash").scenarios([0])[::20]) == len(first.places())
