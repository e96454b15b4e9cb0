from __future__ import annotations

import dataclasses

import pytest

from dohyo.evaluation.criteria import criteria_for
from dohyo.evaluation.criteria.scenario_timeout import ScenarioTimeout
from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.sumo_networks.scenario import Mission, Place, Scenario
from dohyo.sumo_networks.world import EventPhase, EventState, World
from tests.worlds import run, straight_road

WAITING, ACTIVE, DONE, TIMED_OUT = EventPhase


def worlds(*phases: EventPhase, ego: int = 0, name: str = "it") -> list[World]:
    """An ego that drives, and one event in these phases, tick by tick; it was triggered at 0.1 s."""
    told = straight_road().with_ego(x=50, speed=10).worlds(seconds=0.1 * (len(phases) - 1))
    nan = float("nan")
    return [
        dataclasses.replace(
            world,
            events=(
                EventState(
                    name,
                    "accident",
                    ego,
                    phase,
                    nan if phase is WAITING else 0.1,
                    world.time if phase in (DONE, TIMED_OUT) else nan,
                    (),
                    nan,
                ),
            ),
        )
        for world, phase in zip(told, phases, strict=True)
    ]


def test_an_event_whose_time_is_up_counts_once() -> None:
    verdict = run(worlds(WAITING, ACTIVE, ACTIVE, TIMED_OUT, TIMED_OUT, TIMED_OUT), ScenarioTimeout())
    (one,) = verdict.infractions
    assert one.kind is InfractionKind.SCENARIO_TIMEOUT
    assert one.time_s == pytest.approx(0.3)
    assert (one.magnitude, one.unit) == (pytest.approx(0.2), "s")
    assert one.actor == "it"


@pytest.mark.parametrize("phases", [(WAITING,) * 4, (ACTIVE,) * 4, (WAITING, ACTIVE, DONE, DONE)])
def test_an_event_that_waits_goes_on_or_is_over_is_none(phases: tuple[EventPhase, ...]) -> None:
    assert run(worlds(*phases), ScenarioTimeout()).infractions == []


def test_the_event_of_another_ego_is_none() -> None:
    assert run(worlds(ACTIVE, TIMED_OUT, ego=1), ScenarioTimeout()).infractions == []


def test_it_is_judged_by_default_and_ends_nothing() -> None:
    scenario = Scenario(network="x", missions=(Mission(start=Place(lane="a"), goal=Place(lane="b")),))
    assert any(isinstance(one, ScenarioTimeout) for one in criteria_for(scenario))
    assert InfractionKind.SCENARIO_TIMEOUT.specification.ends is None
