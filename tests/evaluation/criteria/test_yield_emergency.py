from __future__ import annotations

import dataclasses
import math

import pytest

from dohyo.evaluation.criteria import criteria_for
from dohyo.evaluation.criteria.yield_emergency import YieldEmergency
from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.sumo_networks.scenario import Mission, Place, Scenario
from dohyo.sumo_networks.world import EventPhase, EventState, World
from tests.worlds import run, straight_road

ACTIVE, DONE, TIMED_OUT = EventPhase.ACTIVE, EventPhase.DONE, EventPhase.TIMED_OUT


def worlds(*story: tuple[EventPhase, float], kind: str = "yield_to_emergency_vehicle", ego: int = 0) -> list[World]:
    """An ego, and an emergency vehicle so far ahead of it [m], tick by tick."""
    scene = straight_road().with_ego(x=200, speed=10).with_actor(x=150, speed=10, length=6.5)
    told = scene.worlds(seconds=0.1 * (len(story) - 1))
    return [
        dataclasses.replace(world, events=(EventState("it", kind, ego, phase, 0.0, world.time, (0,), ahead),))
        for world, (phase, ahead) in zip(told, story, strict=True)
    ]


@pytest.mark.parametrize("ending", [DONE, TIMED_OUT])
def test_an_ego_that_is_still_ahead_at_the_end_counts_once(ending: EventPhase) -> None:
    verdict = run(worlds((ACTIVE, -13.0), (ACTIVE, -12.0), (ending, -11.5), (ending, -11.0)), YieldEmergency())
    (one,) = verdict.infractions
    assert one.kind is InfractionKind.YIELD_EMERGENCY
    assert (one.magnitude, one.unit) == (11.5, "m")
    assert one.time_s == pytest.approx(0.2)
    assert one.actor == worlds((ACTIVE, 0.0))[0].names[0]


@pytest.mark.parametrize(("ahead", "count"), [(-0.1, 1), (0.1, 0), (15.0, 0), (math.nan, 0)])
def test_one_that_was_passed_has_yielded(ahead: float, count: int) -> None:
    assert len(run(worlds((ACTIVE, -5.0), (DONE, ahead)), YieldEmergency()).infractions) == count


@pytest.mark.parametrize(("ahead", "count"), [(-20.0, 1), (0.1, 0), (math.nan, 0)])
def test_one_that_still_runs_is_judged_when_the_drive_ends(ahead: float, count: int) -> None:
    verdict = run(worlds(*[(ACTIVE, ahead)] * 5), YieldEmergency())
    assert [one.magnitude for one in verdict.infractions] == [20.0] * count
    assert all(one.time_s == pytest.approx(0.4) for one in verdict.infractions)


@pytest.mark.parametrize("phase", [EventPhase.WAITING, DONE])
def test_one_that_does_not_run_is_not_judged_at_the_end(phase: EventPhase) -> None:
    assert run(worlds(*[(phase, -20.0)] * 5), YieldEmergency()).infractions == []


def test_other_events_and_other_egos_are_none() -> None:
    for story in (((ACTIVE, -5.0), (DONE, -5.0)), ((ACTIVE, -5.0), (ACTIVE, -5.0))):
        assert run(worlds(*story, kind="hard_brake"), YieldEmergency()).infractions == []
        assert run(worlds(*story, ego=1), YieldEmergency()).infractions == []


def test_it_is_judged_by_default_and_ends_nothing() -> None:
    scenario = Scenario(network="x", missions=(Mission(start=Place(lane="a"), goal=Place(lane="b")),))
    assert any(isinstance(one, YieldEmergency) for one in criteria_for(scenario))
    assert InfractionKind.YIELD_EMERGENCY.specification.ends is None
