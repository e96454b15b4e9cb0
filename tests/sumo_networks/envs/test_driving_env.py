from __future__ import annotations

import copy
import pickle
from typing import Any

import cloudpickle
import gymnasium
import libsumo
import numpy as np
import pytest
import supersuit
from pettingzoo.test import parallel_api_test
from torchrl.envs import PettingZooWrapper
from torchrl.envs.utils import check_env_specs

from dohyo.sumo_networks.ego.control import CONTROLS, InvalidActionError
from dohyo.sumo_networks.envs.driving_env import DrivingEnv
from dohyo.sumo_networks.envs.reward import REWARDS
from dohyo.sumo_networks.envs.scenario_env import scenario_rows
from dohyo.sumo_networks.errors import InvalidInputError, SimulationError, UnknownNameError
from dohyo.sumo_networks.scenario import Mission, Obstacle, Place, Scenario, Traffic
from dohyo.sumo_networks.seeds import HELD_OUT_FROM
from dohyo.sumo_networks.sensors import SENSORS
from tests.conftest import MakeEnv
from tests.sumo_networks.simulation.drives import busy_road, in_ingolstadt, on, standing_at
from tests.worlds import straight_road

LIGHT_TRAFFIC = Traffic(vehicles=8, pedestrians=8, warm_up_s=3.0)
STOP = np.zeros(2)


def light(**changes: object) -> Scenario:
    return in_ingolstadt(**({"traffic": LIGHT_TRAFFIC, "time_limit_s": 6.0} | changes))


def two_egos(**changes: object) -> Scenario:
    first = in_ingolstadt().missions[0]
    second = Mission(name="second", start=Place(lane="29119849#1_2", position_m=8.0), goal=Place(lane="54169280#2_2"))
    return light(missions=(first, second), **changes)


def short(length_m: float = 60.0, **changes: object) -> Scenario:
    """A drive down the straight road."""
    place = Place(lane="w_e_0", position_m=100.0)
    mission = Mission(start=place, goal=place.model_copy(update={"position_m": 100.0 + length_m}))
    return on(straight_road(), mission, **changes)


def drive(env: DrivingEnv, seconds: float, action: Any) -> list[tuple[Any, ...]]:
    """What every step gives, with the same action for all, until nobody drives any more."""
    steps = []
    for _ in range(round(seconds * 10)):
        steps.append(env.step(dict.fromkeys(env.agents, action)))
        if not env.agents:
            break
    return steps


# As others understand environments


@pytest.mark.parametrize("scenario", [light(time_limit_s=2.0), two_egos(time_limit_s=2.0)], ids=["one ego", "two egos"])
def test_pettingzoo_accepts_it(scenario: Scenario, make_env: MakeEnv) -> None:
    parallel_api_test(make_env(scenario, sensors=tuple(SENSORS)), num_cycles=50)


def test_the_same_seed_gives_the_same_episode_and_another_does_not(make_env: MakeEnv) -> None:
    # PettingZoo's own seed test needs two live environments in one process, which libsumo cannot: one after the other.
    def episode(env: DrivingEnv, seed: int) -> list[Any]:
        observations, _ = env.reset(seed=seed)
        seen: list[Any] = [observations]
        for name in env.agents:
            env.action_space(name).seed(5)
        while env.agents and len(seen) < 25:
            step = env.step({name: env.action_space(name).sample() for name in env.agents})
            seen.append(step)
        return seen

    env = make_env(two_egos(), sensors=tuple(SENSORS))
    first, other, again = episode(env, 7), episode(env, 8), episode(env, 7)
    fresh = episode(make_env(two_egos(), sensors=tuple(SENSORS)), 7)
    np.testing.assert_equal(again, first)
    np.testing.assert_equal(fresh, first)
    with pytest.raises(AssertionError):
        np.testing.assert_equal(other[0], first[0])


@pytest.mark.parametrize("seed", [-3, 2**31, 3.7, "7", True, np.float64(4.0), np.int64(-1), [1]])
def test_a_seed_that_is_none_is_refused_and_changes_nothing(make_env: MakeEnv, seed: Any) -> None:
    env = make_env(light(), sensors=("speedometer",), new_seeds=True)
    env.reset(seed=5)
    env.step({name: env.action_space(name).sample() for name in env.agents})
    with pytest.raises(InvalidInputError, match=r"expected a seed, a whole number from 0 to 2147483647, got"):
        env.reset(seed=seed)
    assert (env.scenario.seed, env.world.tick) == (5, 1)
    env.reset()
    follows = env.scenario.seed
    env.reset(seed=5)
    env.reset()
    assert env.scenario.seed == follows


def test_copies_draw_seeds_of_their_own_until_one_is_given(make_env: MakeEnv) -> None:
    env = make_env(short(), sensors=("speedometer",), new_seeds=True)
    copies = [env, copy.deepcopy(env), pickle.loads(pickle.dumps(env)), cloudpickle.loads(cloudpickle.dumps(env))]
    copies.append(DrivingEnv(short(), sensors=("speedometer",), new_seeds=True))

    def seeds(seed: int | None = None) -> list[tuple[int, ...]]:
        found = []
        for one in copies:
            drawn = []
            for first in (seed, None, None):
                one.reset(seed=first)
                drawn.append(one.scenario.seed)
            one.close()
            found.append(tuple(drawn))
        return found

    assert len({seed for drawn in seeds() for seed in drawn}) == 3 * len(copies)
    assert len(set(seeds(7))) == 1, "the same first seed"
    copies = [env, pickle.loads(pickle.dumps(env))]
    assert len(set(seeds())) == 2, "a copy of one that had a seed"


@pytest.mark.parametrize("seed", [0, 2**31 - 1, np.int64(4), np.uint32(2**30)])
def test_whole_numbers_of_numpy_are_seeds(make_env: MakeEnv, seed: Any) -> None:
    env = make_env(light(), sensors=("speedometer",))
    env.reset(seed=seed)
    assert (env.scenario.seed, type(env.scenario.seed)) == (int(seed), int)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_supersuit_accepts_it(make_env: MakeEnv) -> None:
    env = make_env(two_egos(), reward=None, render_mode="rgb_array")
    vector = supersuit.pettingzoo_env_to_vec_env_v1(env)
    both = supersuit.concat_vec_envs_v1(vector, 1, num_cpus=1)
    observations, _ = both.reset(seed=1)
    assert observations["route"].shape == (2, 80, 7)
    observations, rewards, *_ = both.step(np.zeros((2, 2), np.float32))
    assert (observations["route"].shape, rewards.shape) == ((2, 80, 7), (2,))
    both.close()


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_supersuits_episodes_have_seeds_of_their_own_where_the_caller_wants_that(make_env: MakeEnv) -> None:
    def seeds(*, new: bool) -> list[int]:
        env = make_env(light(time_limit_s=0.05), sensors=("speedometer",), new_seeds=new)
        vector, found = supersuit.pettingzoo_env_to_vec_env_v1(env), []
        vector.reset(seed=7)
        for _ in range(3):
            found.append(env.scenario.seed)
            vector.step(np.zeros((1, 2), np.float32))
        return found

    assert seeds(new=False) == [7] * 3
    drawn = seeds(new=True)
    assert drawn[0] == 7
    assert len(set(drawn)) == 3
    assert all(0 <= seed < HELD_OUT_FROM for seed in drawn)
    assert seeds(new=True) == drawn, "the first seed decides all"


def test_it_draws_what_is_around_the_first_ego(make_env: MakeEnv) -> None:
    env = make_env(two_egos(), render_mode="rgb_array")
    env.reset()
    first = env.render()
    env.retire("ego")
    second = env.render()
    assert first is not None
    assert second is not None
    assert first.shape == second.shape == (480, 480, 3)
    assert not np.array_equal(first, second), "the second ego is in the middle once the first has left"
    assert make_env(light()).render() is None


@pytest.mark.parametrize("scenario", [light(), two_egos()], ids=["one ego", "two egos"])
def test_torchrl_accepts_it(scenario: Scenario, make_env: MakeEnv) -> None:
    env = PettingZooWrapper(make_env(scenario, reward=None), return_state=False, use_mask=True)
    check_env_specs(env, seed=0)
    rollout = env.rollout(100, break_when_any_done=True)
    assert rollout.shape[0] == 61, "it ends with the first tick later than 6 s"


# Observations


@pytest.mark.parametrize("control", CONTROLS)
def test_observations_lie_in_their_spaces(control: str, make_env: MakeEnv) -> None:
    env = make_env(two_egos(time_limit_s=2.0), sensors=tuple(SENSORS), control=control, reward=None)
    observations, _ = env.reset()
    for name in env.agents:
        env.action_space(name).seed(3)
    while env.agents:
        for name, observation in observations.items():
            assert list(observation) == list(SENSORS)
            for sensor, array in observation.items():
                assert array.dtype in (np.float32, np.uint8)
                assert env.observation_space(name)[sensor].contains(array), (sensor, array)
        observations = env.step({name: env.action_space(name).sample() for name in env.agents})[0]
    assert env.world.time == pytest.approx(2.1)


def test_an_ego_out_in_the_fields_still_observes(make_env: MakeEnv) -> None:
    env = make_env(short(time_limit_s=30.0), sensors=tuple(SENSORS), control="pedals_steering", reward=None)
    env.reset()
    steps = drive(env, 12.0, np.array([1.0, 0.0, -0.05]))
    observation = steps[-1][0]["ego"]
    assert abs(env.world.egos.position[0, 1]) > 100.0
    assert observation["lane"].tolist() == [0.0] * 5
    assert env.observation_space("ego").contains(observation)
    assert all(np.isfinite(array).all() for array in observation.values())


def test_observations_are_the_callers_own(make_env: MakeEnv) -> None:
    env = make_env(busy_road(), sensors=tuple(SENSORS))
    first, _ = env.reset()
    kept = {sensor: array.copy() for sensor, array in first["ego"].items()}
    drive(env, 2.0, np.array([10.0, 0.1]))
    np.testing.assert_equal(first["ego"], kept)


def test_each_ego_may_have_its_own_sensors_and_control(make_env: MakeEnv) -> None:
    sensors = {"ego": ["speedometer"], "second": ["lane", "junctions_ahead"]}
    control = {"ego": "pedals_steering", "second": "waypoints"}
    env = make_env(two_egos(), sensors=sensors, control=control)
    observations, infos = env.reset()
    assert {name: list(observation) for name, observation in observations.items()} == sensors
    assert infos == {"ego": {}, "second": {}}
    assert [env.action_space(name).shape for name in env.agents] == [(3,), (8, 2)]


# The end of an episode


def test_the_goal_ends_the_episode(make_env: MakeEnv) -> None:
    env = make_env(short(), control="lane_command", reward="progress")
    env.reset()
    steps = drive(env, 30.0, np.array([8.0, 0.0]))
    assert [terminations["ego"] for _, _, terminations, _, _ in steps] == [False] * (len(steps) - 1) + [True]
    assert not any(truncations["ego"] for _, _, _, truncations, _ in steps)
    assert env.agents == []
    assert env.routes[0].length - env.world.egos.progress[0] < 10.0
    assert not env.world.egos.active[0] or env.world.tick == len(steps)
    rewards = [rewards["ego"] for _, rewards, _, _, _ in steps]
    assert sum(rewards) == pytest.approx(env.world.egos.progress[0])


def test_the_first_tick_later_than_the_time_limit_truncates(make_env: MakeEnv) -> None:
    env = make_env(short(time_limit_s=2.0))
    env.reset()
    steps = drive(env, 5.0, STOP)
    assert len(steps) == 21
    assert [step[3]["ego"] for step in steps] == [False] * 20 + [True]
    assert not any(step[2]["ego"] for step in steps)


def test_a_collision_ends_the_episode_where_the_reward_says_so(make_env: MakeEnv) -> None:
    obstacle = Obstacle(x_m=130.0, y_m=-4.8)
    for reward, ended in (("roach", True), ("progress", True), (None, False)):
        env = make_env(short(obstacles=(obstacle,)), control="lane_command", reward=reward)
        env.reset()
        steps = drive(env, 5.0, np.array([10.0, 0.0]))
        assert any(step[2]["ego"] for step in steps) == ended
        if ended:
            assert env.world.contacts
            assert steps[-1][1]["ego"] < -1.0
        else:
            assert {step[1]["ego"] for step in steps} == {0.0}


def test_one_ego_may_go_on_when_another_has_ended(make_env: MakeEnv) -> None:
    near = Mission(name="near", start=Place(lane="w_e_0", position_m=100.0), goal=Place(lane="w_e_0", position_m=140.0))
    env = make_env(on(straight_road(), near, standing_at(300.0, name="far"), time_limit_s=20.0), control="lane_command")
    env.reset()
    steps = drive(env, 30.0, np.array([8.0, 0.0]))
    names = [tuple(step[0]) for step in steps]
    assert names[0] == ("near", "far")
    assert names[-1] == ("far",)
    assert len(steps) == 201
    for observations, rewards, terminations, truncations, infos in steps:
        assert list(observations) == list(rewards) == list(terminations) == list(truncations) == list(infos)


def test_every_episode_starts_anew(make_env: MakeEnv) -> None:
    # In rain the sensors draw noise, and the control integrates: neither may remember the last episode.
    env = make_env(busy_road(conditions="heavy-rain"), sensors=tuple(SENSORS))
    first = [env.reset(), *drive(env, 4.0, np.array([1.0, 0.0]))]
    again = [env.reset()]
    assert env.agents == ["ego"]
    assert env.world.tick == 0
    again += drive(env, 4.0, np.array([1.0, 0.0]))
    np.testing.assert_equal(again, first)


# What cannot be


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"sensors": ["speedometr"]}, "did you mean 'speedometer'"),
        ({"control": "pedal_steering"}, "did you mean 'pedals_steering'"),
        ({"reward": "roche"}, "did you mean 'roach'"),
    ],
)
def test_unknown_names_are_refused_before_sumo_starts(options: dict[str, Any], message: str, make_env: MakeEnv) -> None:
    with pytest.raises(UnknownNameError, match=message):
        make_env(short(), **options)


EACH_EGO = "expected one entry for each of the egos ego, second, got entries for "


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"sensors": "speedometer"}, "sensors: expected a list of names or configurations, got 'speedometer'"),
        ({"sensors": SENSORS["camera_rgb"]}, "sensors: expected a list of names or configurations, got CameraConfig"),
        ({"sensors": 3}, "sensors: expected a list of names or configurations, got 3"),
        ({"sensors": ["lane", 3]}, "sensors: expected a name or a configuration, got 3"),
        ({"sensors": {"ego": ["lane"], "second": "lane"}}, "expected a list of names or configurations, got 'lane'"),
        ({"sensors": {"ego": ["lane"]}}, f"sensors: {EACH_EGO}ego$"),
        ({"sensors": {}}, f"sensors: {EACH_EGO}none$"),
        ({"control": {"ego": "waypoints"}}, f"control: {EACH_EGO}ego$"),
        ({"control": dict.fromkeys(("ego", "second", "third"), "waypoints")}, f"control: {EACH_EGO}ego, second, third"),
        ({"control": None}, "control: expected a name, got None"),
        ({"control": ["waypoints"]}, r"control: expected a name, got \['waypoints'\]"),
        ({"reward": 3}, "reward: expected a name, got 3"),
        ({"render_mode": 3}, "render_mode: expected a name, got 3"),
    ],
)
def test_options_of_another_form_are_refused(options: dict[str, Any], message: str, make_env: MakeEnv) -> None:
    with pytest.raises(InvalidInputError, match=message):
        make_env(two_egos(), **options)


def test_an_impossible_mission_is_refused_before_sumo_starts(make_env: MakeEnv) -> None:
    with pytest.raises(InvalidInputError, match="no lane 'nowhere'"):
        make_env(on(straight_road(), Mission(start=Place(lane="nowhere"), goal=Place(lane="w_e_0"))))


A_SCENARIO = r"expected a Scenario \(see load_benchmark\(...\).scenarios\), got "


@pytest.mark.parametrize(
    ("scenario", "got"),
    [("quickstart", "'quickstart'"), (None, "None"), ([short()], "list"), (straight_road(), "Scene")],
)
def test_what_is_no_scenario_is_refused(scenario: Any, got: str) -> None:
    with pytest.raises(InvalidInputError, match=f"^{A_SCENARIO}{got}$"):
        DrivingEnv(scenario)


def test_an_unknown_ego_is_refused_by_its_name(make_env: MakeEnv) -> None:
    env = make_env(two_egos(), sensors=("speedometer",))
    env.reset()
    for use in (
        lambda: env.outfit("egg", ["lane"], "waypoints"),
        lambda: env.check_action("egg", STOP),
        lambda: env.observe("egg"),
        lambda: env.retire("egg"),
        lambda: env.action_space("egg"),
        lambda: env.observation_space("egg"),
    ):
        with pytest.raises(UnknownNameError, match="no ego named 'egg'; did you mean 'ego'"):
            use()


def test_an_ego_that_has_left_may_be_retired_again(make_env: MakeEnv) -> None:
    env = make_env(two_egos(), sensors=("speedometer",))
    env.reset()
    env.retire("ego")
    env.retire("ego")
    assert env.agents == ["second"]
    assert list(env.step({"second": STOP})[0]) == ["second"]


@pytest.mark.parametrize("actions", [None, [STOP], STOP, "ego"])
def test_actions_without_names_are_refused(actions: Any, make_env: MakeEnv) -> None:
    env = make_env(light(), sensors=("speedometer",))
    env.reset()
    got = type(actions).__name__
    with pytest.raises(InvalidActionError, match=f"^expected actions by the names of egos, got {got}$"):
        env.step(actions)
    env.step({"ego": STOP})


def test_an_invalid_action_moves_nobody(make_env: MakeEnv) -> None:
    env = make_env(two_egos())
    env.reset()
    world = env.world
    with pytest.raises(InvalidActionError):
        env.step({"ego": np.array([5.0, 0.0]), "second": np.array([np.nan, 0.0])})
    assert env.world is world
    with pytest.raises(InvalidActionError):
        env.check_action("second", [1.0])
    env.check_action("second", [1.0, 0.0])
    env.step({"ego": np.array([5.0, 0.0]), "second": np.array([5.0, 0.0])})
    assert env.world.tick == 1


def test_an_invalid_action_of_one_ego_advances_no_control(make_env: MakeEnv) -> None:
    def speeds(refused: int) -> list[float]:
        env = make_env(two_egos(), sensors=("speedometer",), control="target_speed_steering")
        env.reset()
        good = {"ego": np.array([2.0, 0.0]), "second": np.array([2.0, 0.0])}
        for _ in range(refused):
            with pytest.raises(InvalidActionError):
                env.step(good | {"second": np.array([np.nan, 0.0])})
        for _ in range(5):
            env.step(good)
        return [float(speed) for speed in env.world.egos.speed]

    assert speeds(refused=10) == speeds(refused=0)


def test_an_action_for_an_unknown_ego_is_refused(make_env: MakeEnv) -> None:
    env = make_env(light())
    env.reset()
    with pytest.raises(InvalidActionError, match="expected actions for ego, got one for egg"):
        env.step({"ego": STOP, "egg": STOP})
    env.step({"ego": STOP})


def test_a_missing_action_is_named(make_env: MakeEnv) -> None:
    env = make_env(two_egos())
    env.reset()
    with pytest.raises(InvalidActionError, match="second"):
        env.step({"ego": np.array([5.0, 0.0])})


def test_two_open_environments_in_one_process_are_refused(make_env: MakeEnv) -> None:
    first = make_env(short())
    first.reset()
    second = DrivingEnv(short())
    with pytest.raises(SimulationError, match="still open"):
        second.reset()
    first.close()
    first.close()
    second.reset()
    second.close()


def test_a_closed_environment_leaves_an_open_one_alone(make_env: MakeEnv) -> None:
    closed = make_env(light(), sensors=("speedometer",))
    closed.reset()
    open_now = make_env(light(), sensors=("speedometer",))
    open_now.reset()
    before = libsumo.simulation.getTime()
    with pytest.raises(
        SimulationError, match=r"the environment of scenario 'scenario' is closed; call reset\(\) first"
    ):
        closed.step({})
    with pytest.raises(SimulationError, match="is closed"):
        closed.all_actors()
    assert libsumo.simulation.getTime() == before
    assert open_now.step({"ego": STOP})


def test_only_an_environment_that_does_not_run_can_be_copied(make_env: MakeEnv) -> None:
    env = make_env(light(), sensors=("speedometer",))
    fresh = copy.deepcopy(env)
    env.reset(seed=5)
    driven = drive(env, 1.0, np.array([5.0, 0.0]))
    for duplicate in (copy.copy, copy.deepcopy, pickle.dumps):
        with pytest.raises(SimulationError, match="reset another environment with the same seed and actions"):
            duplicate(env)
    env.close()
    again = copy.deepcopy(env)
    for other in (fresh, again, pickle.loads(pickle.dumps(env))):
        other.reset(seed=5)
        np.testing.assert_equal(drive(other, 1.0, np.array([5.0, 0.0])), driven)
        other.close()


@pytest.mark.parametrize("where", ["dohyo.sumo_networks.simulation.Simulation.tick", "libsumo.simulationStep"])
def test_a_step_that_is_interrupted_ends_the_episode(
    where: str, make_env: MakeEnv, monkeypatch: pytest.MonkeyPatch
) -> None:
    def ctrl_c(*_: object) -> None:
        raise KeyboardInterrupt

    env = make_env(light(), sensors=("speedometer",), control="target_speed_steering")
    env.reset(seed=5)
    whole = drive(env, 1.0, np.array([5.0, 0.0]))
    env.reset(seed=5)
    drive(env, 0.5, np.array([5.0, 0.0]))
    with monkeypatch.context() as patch:
        patch.setattr(where, ctrl_c)
        with pytest.raises(KeyboardInterrupt):
            drive(env, 0.1, np.array([5.0, 0.0]))
    with pytest.raises(SimulationError, match=r"was interrupted or failed in a step; call reset\(\) first"):
        drive(env, 0.1, np.array([5.0, 0.0]))
    env.retire("ego")
    env.reset(seed=5)
    np.testing.assert_equal(drive(env, 1.0, np.array([5.0, 0.0])), whole)


def test_a_forgotten_environment_makes_room_for_the_next() -> None:
    for _ in range(2):
        env = DrivingEnv(short(), sensors=("speedometer",))
        env.reset()
        del env
    in_a_cycle = DrivingEnv(short(), sensors=("speedometer",))
    in_a_cycle.myself = in_a_cycle  # only the garbage collection finds it
    in_a_cycle.reset()
    del in_a_cycle
    last = DrivingEnv(short(), sensors=("speedometer",))
    last.reset()
    last.close()


def test_spaces_are_known_before_the_first_episode(make_env: MakeEnv) -> None:
    env = make_env(two_egos(), sensors=tuple(SENSORS))
    assert env.possible_agents == ["ego", "second"]
    for name in env.possible_agents:
        assert env.observation_space(name) is env.observation_space(name)
        assert env.action_space(name).contains(env.action_space(name).sample())
    assert set(REWARDS) >= {"roach", "progress"}


def test_no_space_shares_its_generator_with_another() -> None:
    envs = [DrivingEnv(two_egos(), sensors=("speedometer",)) for _ in range(2)]
    spaces = [space for env in envs for name in env.possible_agents for space in spaces_of(env, name)]
    for seed, space in enumerate(spaces):
        space.seed(seed)
    drawn = [space.sample() for space in spaces]
    for seed, space in enumerate(spaces):
        space.seed(seed)
        np.testing.assert_equal(space.sample(), drawn[seed])
    vectors = [scenario_rows([light()], 1, sensors=("speedometer",)).action_space for _ in range(2)]
    assert not np.array_equal(vectors[0].sample(), vectors[1].sample())


def spaces_of(env: DrivingEnv, name: str) -> tuple[gymnasium.Space[Any], ...]:
    return env.action_space(name), env.observation_space(name)


def test_there_is_a_world_from_the_first_reset_on_and_also_after_the_end(make_env: MakeEnv) -> None:
    env = make_env(on(straight_road(), standing_at(100.0)), reward=None)
    assert not env.started
    with pytest.raises(SimulationError, match="has not started; call reset"):
        _ = env.world
    env.reset()
    assert env.started
    env.close()
    assert env.started
    assert env.world.tick == 0
