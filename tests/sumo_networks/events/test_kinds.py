"""Every kind of event: it is placed, triggered, demands what it should, and leaves the road as it was."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dohyo.sumo_networks.envs.driving_env import DrivingEnv
from dohyo.sumo_networks.events import EVENTS
from dohyo.sumo_networks.scenario import Place
from dohyo.sumo_networks.world import EventPhase, World
from tests.conftest import MakeEnv
from tests.sumo_networks.events.stories import STORIES, Story, careful, drive, over, rows_of, state, touched

every_kind = pytest.mark.parametrize("story", STORIES.values(), ids=lambda story: story.kind)
AFTERWARDS_S = 25.0


def test_there_is_a_story_for_every_kind() -> None:
    assert set(STORIES) == set(EVENTS)


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


QUEUE_M = 30.0


def behind_another(kind: str, make_env: MakeEnv) -> DrivingEnv:
    """The ego of a story, and another one 30 m ahead of it."""
    story = STORIES[kind]
    scenario = story.scenario()
    (way,) = scenario.missions
    start = Place(lane=way.start.lane, position_m=way.start.position_m + QUEUE_M)
    ahead = way.model_copy(update={"name": "ahead", "start": start})
    both = scenario.model_copy(update={"missions": (way, ahead)})
    return make_env(both, control="lane_command", reward=None)


def queue_at(env: DrivingEnv, s: float, seconds: float) -> list[World]:
    """Both stop, the other one at a point of the ego's route and the ego 8 m behind it."""
    if not env.agents:
        env.reset()
    worlds = []
    for _ in range(round(10 * seconds)):
        own, ahead = env.world.egos.progress.tolist()
        left = {"ego": s - 8.0 - own, "ahead": s - QUEUE_M - ahead}
        env.step({name: np.array([min(8.0, 2.0 * math.sqrt(max(left[name], 0.0))), 0.0], np.float32) for name in left})
        worlds.append(env.world)
    return worlds


def test_a_blocked_junction_is_cleared_for_an_ego_that_others_keep_from_coming_near(make_env: MakeEnv) -> None:
    worlds = queue_at(behind_another("blocked_intersection", make_env), 125.0, 80.0)
    stood = next(world.time for world in worlds if world.time > 15.0 and world.egos.speed.max() < 0.5)
    moving = [world.time for world in worlds if (rows := rows_of(world)) and world.actors.speed[rows[0]] > 1.0]
    assert worlds[-1].egos.progress[0] < 125.0  # farther than 25 m from what blocks it
    assert moving[0] - stood == pytest.approx(30.0 + 10.0, abs=2.0)


def test_a_flow_pauses_for_others_who_keep_the_ego_from_it(make_env: MakeEnv) -> None:
    env = behind_another("left_turn_unsignalised", make_env)
    came = [len(state(world).actors) for world in queue_at(env, 140.0, 80.0)]
    assert came[300] > came[200] > came[150]
    assert came[-1] == came[-300], "nobody came for half a minute"
    again = queue_at(env, 144.0, 20.0)
    assert len(state(again[-1]).actors) > came[-1], "the ego has moved on, and they come again"
