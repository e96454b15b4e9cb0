"""ParkingEnv and ParkingVectorEnv: the interfaces of PettingZoo and of the learners, seeds, errors, pictures."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pettingzoo.test import parallel_api_test, parallel_seed_test

from dohyo.agents.learning.tasks.environments import check_environments
from dohyo.sumo_networks.ego.control import InvalidActionError
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.parking.env import ParkingEnv
from dohyo.sumo_networks.parking.generate import Scene
from dohyo.sumo_networks.parking.lot import Block, Lot, Pedestrian, Pose, Spot
from dohyo.sumo_networks.parking.rules import ALIGNED, JUDGED, SIMPLE
from dohyo.sumo_networks.parking.vector_env import Level, ParkingVectorEnv
from tests.sumo_networks.parking.lots import REST, lot_of

IN_PLACE = lot_of(Pose(x_m=0.0, y_m=0.0, heading_rad=math.pi / 2))


def test_it_is_a_parallel_env_of_pettingzoo():
    parallel_api_test(ParkingEnv(Scene.PEDESTRIANS, karts=3, rules=JUDGED), num_cycles=100)
    parallel_seed_test(lambda: ParkingEnv(Scene.COMPLEX, karts=2), num_cycles=10)


@pytest.mark.parametrize("seed", [True, 1.5, "a", -1, 2**31, 2**63, 2**70])
def test_a_wrong_seed_is_refused_before_anything_changes(seed):
    env, untouched = ParkingEnv(Scene.COMPLEX), ParkingEnv(Scene.COMPLEX)
    env.reset(seed=3)
    untouched.reset(seed=3)
    with pytest.raises(InvalidInputError, match="expected a seed, a whole number"):
        env.reset(seed=seed)
    assert env.agents == ["kart-0"]
    assert np.array_equal(env.reset()[0]["kart-0"], untouched.reset()[0]["kart-0"])
    assert np.array_equal(env.reset(seed=np.int64(3))[0]["kart-0"], untouched.reset(seed=3)[0]["kart-0"])


@pytest.mark.parametrize(
    ("scene", "karts", "said"),
    [
        (Scene.COMPLEX, 2.5, "expected 1 to 8 karts, got 2.5"),
        (Scene.COMPLEX, "2", "expected 1 to 8 karts, got '2'"),
        (Scene.COMPLEX, True, "expected 1 to 8 karts, got True"),
        (Scene.COMPLEX, 0, "expected 1 to 8 karts, got 0"),
        (Scene.PARALLEL, 6, "expected 1 to 5 karts in the scene 'parallel', got 6"),
    ],
)
def test_a_number_of_karts_that_no_lot_has_is_refused_at_once(scene, karts, said):
    with pytest.raises(InvalidInputError, match=said):
        ParkingEnv(scene, karts)


@pytest.mark.parametrize("scene", ["complex", 1, None])
def test_what_is_no_scene_is_refused_at_once(scene):
    with pytest.raises(InvalidInputError, match=f"expected Scene.SIMPLE, .* or a Lot, got {scene!r}"):
        ParkingEnv(scene)


def test_the_last_info_says_how_the_episode_ended():
    env = ParkingEnv(IN_PLACE, rules=JUDGED)
    env.reset()
    for _ in range(10):
        _, rewards, terminations, _, infos = env.step({"kart-0": REST})
    assert (rewards["kart-0"], terminations["kart-0"], env.agents) == (1.0, True, [])
    assert infos["kart-0"] == {"outcome": "parked", "success": True, "aligned": True, "time_s": 1.0}
    with pytest.raises(InvalidInputError, match="expected reset before step"):
        env.step({"kart-0": REST})


@pytest.mark.parametrize(
    ("actions", "said"),
    [
        ({"kart-0": np.zeros(2)}, r"action of 'kart-0': expected actions of shape \(3,\), got shape \(2,\)"),
        ({"kart-0": np.array([0, np.nan, 0])}, "action of 'kart-0': expected finite actions"),
        ({}, r"expected an action of 'kart-0', got actions of \[\]"),
        (None, "expected actions by the names of karts, got NoneType"),
        (np.zeros(3), "expected actions by the names of karts, got ndarray"),
        ({"kart-0": REST, "kart-7": REST, 1: REST}, "expected actions of kart-0, got some of 1, kart-7"),
    ],
)
def test_a_wrong_action_is_one_error_and_moves_nothing(actions, said):
    env = ParkingEnv(IN_PLACE)
    before, _ = env.reset()
    with pytest.raises(InvalidActionError, match=said):
        env.step(actions)
    assert np.array_equal(env.reset()[0]["kart-0"], before["kart-0"])


def test_an_action_of_a_kart_whose_episode_has_ended_is_ignored():
    places = Pose(x_m=0.0, y_m=0.0, heading_rad=math.pi / 2), Pose(x_m=12.0, y_m=-4.0, heading_rad=math.pi / 2)
    env = ParkingEnv(lot_of(*places), rules=JUDGED)
    env.reset()
    while "kart-0" in env.agents:
        env.step(dict.fromkeys(env.agents, REST))
    assert env.agents == ["kart-1"]
    assert env.step(dict.fromkeys(env.possible_agents, REST))[1].keys() == {"kart-1"}


@pytest.mark.parametrize(("state", "width"), [("v1", 54), ("v2", 57), ("oriented", 64)])
def test_the_state_chooses_columns_of_one_observation(state, width):
    seen, _ = ParkingEnv(Scene.COMPLEX, state=state).reset(seed=3)
    whole, _ = ParkingEnv(Scene.COMPLEX, state="oriented").reset(seed=3)
    assert seen["kart-0"].shape == (width,)
    assert np.array_equal(seen["kart-0"][:9], whole["kart-0"][:9])
    assert np.array_equal(seen["kart-0"][-45:], whole["kart-0"][-45:])


def test_observations_are_those_of_the_documented_columns():
    env = ParkingEnv(lot_of(Pose(x_m=1.0, y_m=-4.0, heading_rad=math.pi / 2 + 0.1)))
    seen = env.reset()[0]["kart-0"]
    expected = [
        *(0.5 + 0.1 / math.pi, 1 / 80, -4 / 80, 0, 0, 0, 0, 0, 0, -1 / 80, 4 / 80, 0),
        *(math.cos(0.1), math.sin(0.1), -4 / 5, -1 / 5, 0, 0, 0),
    ]
    assert np.allclose(seen[:19], expected, atol=1e-6)
    assert np.array_equal(seen[19:], np.tile([1, 0, 0, 0, 0], 9))


def test_pictures_show_the_kart_where_it_is():
    env = ParkingEnv(Scene.PEDESTRIANS, karts=2, render_mode="rgb_array")
    env.reset(seed=1)
    first = env.render()
    assert first.shape == (480, 480, 3)
    assert first.dtype == np.uint8
    for _ in range(20):
        env.step(dict.fromkeys(env.agents, np.array([1.0, 0.0, -1.0])))
    assert 20 < (env.render() != first).any(axis=2).sum() < 20_000
    assert ParkingEnv().render() is None
    with pytest.raises(InvalidInputError, match="render_mode"):
        ParkingEnv(render_mode="human")
    with pytest.raises(UnknownNameError, match="no state named 'x'"):
        ParkingEnv(state="x")  # type: ignore[arg-type]  # what a caller may give


def test_pictures_show_long_blocks_and_the_ways_of_pedestrians_to_their_ends():
    """In a lot without walls, which end the picture elsewhere."""
    lot = Lot(
        blocks=(Block(x_m=0, y_m=10, length_m=60, width_m=1),),
        spots=(Spot(x_m=0, y_m=5, heading_rad=0, length_m=5, width_m=2.5),),
        karts=(Pose(x_m=0, y_m=-5),),
        pedestrians=(Pedestrian(x0_m=20, y0_m=-1, x1_m=20, y1_m=-40, speed_mps=3.0),),
    )
    env = ParkingEnv(lot, render_mode="rgb_array")
    env.reset()
    block = (env.render() < 60).all(axis=2)
    assert block.any(axis=0).sum() == pytest.approx(480 * 60 / 61, abs=2)
    for _ in range(125):
        env.step({"kart-0": np.array([0.0, 0.0, 1.0])})
    walker = (np.abs(env.render().astype(int) - [183, 121, 31]) < 20).all(axis=2)
    assert 5 < walker.sum() < 40
    assert np.flatnonzero(walker.any(axis=1)).min() > 400  # far to the south of where it began


def test_rows_of_a_lot_are_a_group_and_wait_for_its_reset():
    levels = [Level(Scene.SIMPLE, SIMPLE), Level(Scene.COMPLEX, ALIGNED)]
    envs = ParkingVectorEnv(4, levels, karts=3)
    check_environments(envs)
    assert (envs.num_envs, envs.group_size) == (12, 3)
    first, _ = envs.reset(seed=list(range(12)), options={"level": 1})
    actions = np.zeros((12, 3))
    actions[1, 0] = -1.0
    _, rewards, terminations, truncations, infos = envs.step(actions)
    assert rewards.tolist() == [0, -1, *[0] * 10]
    assert terminations.tolist() == [False, True, *[False] * 10]
    assert not truncations.any()
    assert infos["_success"].tolist() == terminations.tolist()
    assert not infos["success"].any()
    _, _, _, _, infos = envs.step(actions * 0)
    assert infos["active"].tolist() == [True, False, *[True] * 10]
    mask = np.arange(12) == 1
    again, _ = envs.reset(seed=list(range(12)), options={"level": 1, "reset_mask": mask})
    assert np.array_equal(again["observation"][:3], first["observation"][:3])
    assert not np.array_equal(again["observation"][3:], first["observation"][3:])
    assert envs.running.all()


def test_an_unknown_level_and_no_lots_are_refused():
    envs = ParkingVectorEnv(1, [Level(Scene.SIMPLE)])
    with pytest.raises(InvalidInputError, match="level below 1, got 1"):
        envs.reset(options={"level": 1})
    with pytest.raises(InvalidInputError, match="at least one lot"):
        ParkingVectorEnv(0, [Level(Scene.SIMPLE)])


def test_a_number_of_karts_that_a_level_cannot_have_is_refused_at_once():
    levels = [Level(Scene.COMPLEX), Level(Scene.PARALLEL)]
    ParkingVectorEnv(1, levels, karts=5).reset(seed=0, options={"level": 1})
    ParkingVectorEnv(1, levels[:1], karts=8).reset(seed=0)
    with pytest.raises(InvalidInputError, match="at most 5 karts with a level of the scene 'parallel', got 6"):
        ParkingVectorEnv(1, levels, karts=6)
