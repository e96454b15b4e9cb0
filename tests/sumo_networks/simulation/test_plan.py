"""ScenarioPlan: what is refused before SUMO starts."""

from __future__ import annotations

import pytest

from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.simulation import ScenarioPlan, plan_scenario
from tests.sumo_networks.simulation.drives import in_ingolstadt


def planned(ahead_m: float) -> ScenarioPlan:
    """Two egos on one lane, the second a way ahead of the first."""
    (first,) = in_ingolstadt().missions
    ahead = first.start.model_copy(update={"position_m": first.start.position_m + ahead_m})
    second = first.model_copy(update={"name": "second", "start": ahead})
    return plan_scenario(load_network("ingolstadt"), in_ingolstadt(missions=(first, second)))


@pytest.mark.parametrize("ahead_m", [0.0, 4.0, -4.0])
def test_egos_that_touch_at_their_starts_are_refused(ahead_m: float) -> None:
    with pytest.raises(InvalidInputError, match=r"^missions 'ego' and 'second' start too near each other: .* touch at"):
        planned(ahead_m)


def test_egos_one_behind_the_other_are_planned() -> None:
    assert len(planned(5.0).routes) == 2
