"""Environments of benchmarks: by gymnasium's ids and by dohyo.make_vec."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import FlattenObservation, RenderCollection
from gymnasium.wrappers.vector import FlattenObservation as FlattenVectorObservation

import dohyo
from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.evaluation.benchmarks.environments import single_scenarios
from dohyo.sumo_networks.envs.driving_env import DrivingEnv
from dohyo.sumo_networks.envs.single_env import SingleDrivingEnv
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.catalog import load_network

MISSION = {
    "start": {"lane": "737320747#3_2", "position_m": 20.0},
    "goal": {"lane": "726514449_2", "position_m": -15.0},
}
OWN = {"network": "ingolstadt", "missions": [MISSION]}


def test_gymnasium_makes_the_benchmark_with_its_missions() -> None:
    env = gymnasium.make("dohyo/Quickstart-v0", time_limit_s=0.95)
    assert isinstance(env.unwrapped, SingleDrivingEnv)
    assert len(env.unwrapped.scenarios) == 6
    flat = FlattenObservation(env)
    observation, info = flat.reset(seed=1)
    assert observation.shape == (2 + 80 * 7 + 48 * 8 + 4 * 4,)
    assert info["scenario"] in {mission.name for mission in load_benchmark("quickstart").missions["all"]}
    ends = [flat.step(flat.action_space.sample())[2:4] for _ in range(10)]
    assert any(ends[-1])
    flat.close()


def test_gymnasiums_wrappers_collect_a_frame_per_step() -> None:
    env = RenderCollection(gymnasium.make("dohyo/Quickstart-v0", time_limit_s=0.95, render_mode="rgb_array"))
    env.reset(seed=1)
    for _ in range(3):
        env.step(env.action_space.sample())
    frames = env.render()
    assert frames is not None
    assert [frame.shape for frame in frames] == [(480, 480, 3)] * 4
    env.close()


def test_gymnasium_makes_missions_of_ones_own() -> None:
    options = {"network": "ingolstadt", "missions": [MISSION], "traffic": {"vehicles": 3, "warm_up_s": 1.0}}
    env = gymnasium.make("dohyo/Driving-v0", sensors=("speedometer",), control="pedals_steering", **options)
    assert set(env.observation_space) == {"speedometer"}
    assert env.action_space.shape == (3,)
    assert env.reset(seed=0)[1]["scenario"] == "mission-1"
    env.close()


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_gymnasium_makes_two_at_once_for_its_wrappers() -> None:
    env = gymnasium.make_vec("dohyo/Quickstart-v0", num_envs=2, time_limit_s=0.45, render_mode="rgb_array")
    assert env.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    flat = FlattenVectorObservation(env)
    observations, _ = flat.reset(seed=1)
    assert observations.shape[0] == 2
    frames = env.render()
    assert frames is not None
    assert [frame.shape for frame in frames] == [(480, 480, 3)] * 2
    ends = []
    for _ in range(7):
        observations, _, _, truncations, infos = flat.step(np.zeros((2, 2), np.float32))
        ends.append(truncations.tolist())
    assert ends == [[False] * 2] * 4 + [[True] * 2] + [[False] * 2] * 2
    assert infos["episode_number"].tolist() == [2, 3]
    flat.close()


def test_gymnasium_makes_processes_of_its_own() -> None:
    env = gymnasium.make_vec("dohyo/Quickstart-v0", num_envs=2, vectorization_mode="async", time_limit_s=0.45)
    observations, infos = env.reset(seed=1)
    assert observations["speedometer"].shape == (2, 2)
    assert len(set(infos["seed"].tolist())) == 2
    env.close()


def test_a_source_is_a_benchmark_or_scenarios() -> None:
    whole = single_scenarios("quickstart")
    assert single_scenarios(load_benchmark("quickstart")) == single_scenarios(whole) == whole
    assert single_scenarios(whole[0]) == whole[:1]


def test_make_vec_is_the_vector_environment_by_another_way() -> None:
    scenario = load_benchmark("quickstart").scenarios([0])[0]
    env = dohyo.make_vec(scenario, num_envs=1, autoreset_mode=AutoresetMode.SAME_STEP, sensors=("speedometer",))
    assert (env.num_envs, env.num_egos, env.autoreset_mode) == (1, 1, AutoresetMode.SAME_STEP)
    assert set(env.single_observation_space) == {"speedometer"}
    env.close()


def test_options_beside_a_source_are_refused_rather_than_ignored() -> None:
    surplus = {"conditions": "heavy-rain", "traffic": {"vehicles": 0, "pedestrians": 0}, "missions": [MISSION]}
    for make in (gymnasium.make, gymnasium.make_vec):
        with pytest.raises(InvalidInputError, match=r"^missions, traffic, conditions: only for a network"):
            make("dohyo/Quickstart-v0", **surplus)
    with pytest.raises(InvalidInputError, match=r"^conditions: only for a network"):
        dohyo.make_vec("quickstart", 2, conditions="no-such-weather")


@pytest.mark.parametrize("name", [None, 5, Path("quickstart.toml")])
def test_names_that_are_no_text_are_refused(name: Any) -> None:
    for load, what in ((load_benchmark, "benchmark"), (load_network, "network")):
        with pytest.raises(InvalidInputError, match=f"^expected the name of a {what}, or the path of its file as text"):
            load(name)


def test_every_episode_has_an_end() -> None:
    own, given = single_scenarios("nocrash"), single_scenarios("nocrash", time_limit_s=30.0)
    assert {scenario.time_limit_s for scenario in given} == {30.0}
    assert [scenario.time_limit_s for scenario in own] == [
        scenario.time_limit_s for scenario in load_benchmark("nocrash").scenarios([0])
    ], "the benchmark's own limits"
    assert all((scenario.time_limit_s or 0.0) > 300.0 for scenario in single_scenarios("quickstart"))


@pytest.mark.parametrize("limit_s", [-1.0, 0.0, math.nan, math.inf, "60", True])
def test_a_time_limit_that_cannot_pass_is_refused(limit_s: Any) -> None:
    says = f"expected a finite time_limit_s above 0, in seconds, got {limit_s!r}"
    with pytest.raises(InvalidInputError, match=says):
        gymnasium.make("dohyo/Quickstart-v0", time_limit_s=limit_s)
    with pytest.raises(InvalidInputError, match=says):
        dohyo.make_vec("quickstart", num_envs=1, time_limit_s=limit_s)
    scenario = load_benchmark("quickstart").scenarios([0])[0].model_copy(update={"time_limit_s": limit_s})
    with pytest.raises(InvalidInputError, match=says):
        DrivingEnv(scenario)


@pytest.mark.parametrize(
    ("source", "options", "says"),
    [
        (None, {}, "either a benchmark or scenarios, or a network"),
        ("quickstart", {"network": "ingolstadt"}, "either a benchmark or scenarios, or a network"),
        (None, {"network": "ingolstadt"}, "at least one scenario"),
        ("quickstart", {"missions": []}, "^missions: only for a network, got a benchmark or scenarios"),
        ("quickstart", {"traffic": {"vehicles": 0}}, "^traffic: only for a network"),
        ("no-such", {"conditions": "clear", "traffic": {}}, "^traffic, conditions: only for a network"),
        (5, {}, r"^expected a Scenario \(see load_benchmark\(...\).scenarios\), got 5$"),
        (["quickstart"], {}, "^expected a Scenario .*, got 'quickstart'$"),
        ("val14", {}, "amid recorded traffic"),
        ("fleet", {}, "expected one ego"),
        ("quickstrat", {}, "did you mean 'quickstart'"),
        (None, OWN | {"missions": "mine"}, r"^missions: expected a list, got 'mine'$"),
        (
            None,
            OWN | {"missions": [{"start": {"lan": "x"}}]},
            r"^missions\.0\.start\.lan: unknown key; did you mean",
        ),
        (None, OWN | {"traffic": {"vehicle": 3}}, r"^traffic\.vehicle: unknown key; did you mean 'vehicles'"),
        (None, OWN | {"traffic": "dense"}, "^traffic: expected a table, got 'dense'$"),
        (None, OWN | {"conditions": ("wet",)}, r"^conditions: expected text, got \('wet',\)$"),
    ],
)
def test_impossible_sources_are_refused(source: Any, options: dict[str, Any], says: str) -> None:
    with pytest.raises(InvalidInputError, match=says):
        single_scenarios(source, **options)
