"""Every kind of event: it is placed, triggered, demands what it should, and leaves the road as it was."""

from __future__ import annotations

import pytest

from sumo_networks.events import KINDS
from sumo_networks.world import EventPhase
from tests.conftest import MakeEnv
from tests.sumo_networks.events.stories import STORIES, Story, careful, drive, over, rows_of, state, touched

every_kind = pytest.mark.parametrize("story", STORIES.values(), ids=lambda story: story.kind)
AFTERWARDS_S = 25.0


def test_there_is_a_story_for_every_kind() -> None:
    assert set(STORIES) == set(KINDS)


@every_kind
def test_it_happens_where_it_should_and_is_gone_afterwards(story: Story, make_env: MakeEnv) -> None:
    env = make_env(story.scenario(), control="lane_command", reward=None)
    worlds = drive(env, lambda _: story.speed, 120.0, until=over)
    phases = [state(world).phase for world in worlds]
    first = phases.index(EventPhase.ACTIVE) if EventPhase.ACTIVE in phases else len(phases) - 1
    assert worlds[first].egos.progress[0] > story.at_m - 2.0
    assert first == 1 or worlds[first - 1].egos.progress[0] <= story.at_m - 2.0
    assert state(worlds[first]).started == pytest.approx(worlds[first].time)
    assert phases[-1] is EventPhase.DONE
    assert state(worlds[-1]).ended == pytest.approx(worlds[-1].time)
    assert set(phases[:first]) <= {EventPhase.WAITING}

    seen = state(worlds[-1]).actors
    assert seen, "nobody came"
    assert all(worlds[-1].names[key].startswith("event:it-") for key in seen)
    assert bool(touched(worlds)) or not story.demands

    afterwards = drive(env, lambda _: 0.0, AFTERWARDS_S)
    left = [afterwards[-1].names[afterwards[-1].actors.key[row]] for row in rows_of(afterwards[-1])]
    assert [name for name in left if "-flow" not in name] == []


@pytest.mark.parametrize("kind", ["left_turn_unsignalised", "right_turn_into_flow", "merge_into_slow_traffic"])
def test_vehicles_of_a_flow_come_with_gaps_while_the_ego_waits(kind: str, make_env: MakeEnv) -> None:
    story = STORIES[kind]
    env = make_env(story.scenario(), control="lane_command", reward=None)
    worlds = drive(env, lambda world: story.speed if world.egos.progress[0] < story.at_m else 0.0, 40.0)
    assert state(worlds[-1]).phase is EventPhase.ACTIVE
    assert len(state(worlds[-1]).actors) >= 5
    assert len(state(worlds[-1]).actors) <= 40


@pytest.mark.parametrize("kind", ["vehicle_appears", "pedestrian_steps_out", "blocked_intersection", "hard_brake"])
def test_an_ego_that_stops_can_go_on_again(kind: str, make_env: MakeEnv) -> None:
    story = STORIES[kind]
    env = make_env(story.scenario(), control="lane_command", reward=None)
    fast = story.speed - 1.0
    worlds = drive(env, careful(story.speed), 90.0, until=lambda world: over(world) and world.egos.speed[0] > fast)
    assert touched(worlds) == []
    stopped = [world.time for world in worlds if world.egos.speed[0] < 0.2 and state(world).phase is EventPhase.ACTIVE]
    assert stopped, "it did not have to stop"
    assert over(worlds[-1])
    assert worlds[-1].egos.speed[0] > fast
