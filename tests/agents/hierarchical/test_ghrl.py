"""The agent: its checkpoints, its arms, what it explains, and who drives when it is critical."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch
from tensordict import TensorDict

from dohyo.agents.hierarchical import ghrl
from dohyo.agents.hierarchical.environments.mission_env import MissionEnv, MissionTask
from dohyo.agents.hierarchical.environments.scenarios import draw_scenario
from dohyo.agents.hierarchical.ghrl import ARMS, Ghrl
from dohyo.agents.hierarchical.hierarchy import CONFIG, WEIGHTS, read_sub_policies
from dohyo.agents.hierarchical.master import read_master
from dohyo.agents.hierarchical.options.manoeuvres import DRIVE, Manoeuvre
from dohyo.agents.hierarchical.training.master_training import OptionCritic, OptionCriticConfig
from dohyo.agents.hierarchical.training.subpolicies import SubPolicyConfig
from dohyo.agents.learning.experience.collector import Collector
from dohyo.agents.learning.files.settings import as_toml
from dohyo.agents.learning.tasks.task import SINGLE
from dohyo.agents.rules.rules_only import RulesOnly
from dohyo.evaluation.agent import agent_info, make_agent
from dohyo.sumo_networks.envs.driving_env import DrivingEnv
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.world import LightState
from tests.agents.driving import drive, observed
from tests.agents.hierarchical.untrained import TWIN, write_master, write_sub_policies
from tests.worlds import lit_crossing, straight_road

ENTRY = "dohyo.agents.hierarchical.ghrl:Ghrl"


@pytest.fixture(scope="module")
def runs(tmp_path_factory) -> Path:
    folder = write_sub_policies(tmp_path_factory.mktemp("runs"))
    write_master(folder)
    return folder


@pytest.mark.parametrize("arm", ARMS)
def test_every_arm_drives_and_explains_itself(runs, arm):
    agent = Ghrl(arm, runs)
    assert agent.explain() is None
    worlds = drive(agent, straight_road().with_ego(x=100.0, speed=8.0).with_actor(x=150.0, speed=6.0), 3.0)
    assert np.isfinite(worlds[-1].egos.position).all()
    told = json.loads(json.dumps(agent.explain()))
    assert told["arm"] == arm
    if arm != "flat":
        assert told["option"] in set(Manoeuvre)
        assert Manoeuvre.LANE.value in told["available"]
        assert told["q"].keys() == told["beta"].keys() == {one.value for one in Manoeuvre}
    assert ("rss" in told) is (arm in ("ghrl-r", "ghrl-s"))


def test_a_shield_that_is_always_on_brakes_where_the_policy_would_not(runs):
    scene = lit_crossing().with_ego(x=-40.0, speed=9.0).with_lights(LightState.RED)
    free, shielded = (drive(Ghrl(arm, runs), scene, 8.0)[-1].egos for arm in ("ghrl", "ghrl-s"))
    line = lit_crossing().stop_line("w_c_0")
    assert float(free.position[0, 0]) > line
    assert line - 8.0 < float(shielded.position[0, 0]) < line
    assert float(shielded.speed[0]) == pytest.approx(0.0, abs=0.05)


def test_the_same_episode_is_driven_the_same_way_again(runs):
    agent = Ghrl("ghrl-r", runs)
    scene = straight_road().with_ego(x=100.0, speed=8.0).with_actor(x=130.0, speed=3.0)
    one, other = (np.array([world.egos.position[0] for world in drive(agent, scene, 4.0)]) for _ in range(2))
    assert np.array_equal(one, other)


@pytest.mark.parametrize("arm", ["ghrl", "ghrl-r"])
def test_it_drives_as_the_master_did_in_training(runs, arm):
    task = MissionTask(TWIN, rules_when_critical=arm == "ghrl-r")
    scenario = draw_scenario(DRIVE, 3)
    journey = MissionEnv(task)
    master, config = read_master(runs / "master" / WEIGHTS), OptionCriticConfig()
    collector = Collector(task.make_environments(1, processes=False), task, 0)
    learner = OptionCritic(master, collector, config, 0, torch.device("cpu"))
    try:
        seen, trained = journey.reset(seed=3)[0], []
        for _ in range(60):
            seen = journey.step(learner.act(TensorDict({SINGLE: torch.from_numpy(seen)[None]}, [1]))[0])[0]
            trained.append(journey.driving.world.egos.position[0])
    finally:
        journey.close()
    agent = Ghrl(arm, runs)
    env = DrivingEnv(scenario, agent.spec.sensors, agent.spec.control, reward=None)
    try:
        observation, driven = env.reset()[0]["ego"], []
        agent.reset(scenario.missions[0], scenario.seed)
        for _ in range(60):
            observation = env.step({"ego": agent.act(observation)})[0]["ego"]
            driven.append(env.world.egos.position[0])
    finally:
        env.close()
    assert np.allclose(trained, driven, atol=1e-3), "it answers in double precision, and rounds"
    assert np.ptp(driven, axis=0).max() > 0.5


def test_where_it_is_critical_the_rules_alone_drive_and_only_in_ghrl_r(runs):
    scene = straight_road().with_ego(x=100.0, speed=12.0).with_actor(x=112.0, speed=0.0)
    rules, ruled, alone = RulesOnly(), Ghrl("ghrl-r", runs), Ghrl("ghrl", runs)
    for agent in (rules, ruled, alone):
        agent.reset(scene.mission, 0)
    world = scene.world()
    wanted = rules.act(observed(rules, world))
    assert wanted[0] < -4.0
    assert ruled.act(observed(ruled, world)).tolist() == wanted.tolist()
    assert alone.act(observed(alone, world)).tolist() != wanted.tolist()
    told = ruled.explain()
    assert told is not None
    assert told["rules_drive"]
    assert told["rss"]["critical"]
    assert {"facts", "fired"} & told.keys()


def test_without_a_checkpoint_the_command_that_trains_it_is_named(tmp_path):
    with pytest.raises(InvalidInputError, match=r"dohyo train hierarchical-master --config .*master.toml"):
        Ghrl("ghrl", tmp_path)
    with pytest.raises(InvalidInputError, match=r"dohyo train hierarchical-flat --config .*drive.toml"):
        Ghrl("flat", tmp_path)
    with pytest.raises(InvalidInputError, match=r"dohyo train hierarchical-lane --config .*lane.toml"):
        read_sub_policies(tmp_path)


def test_where_nothing_ships_the_way_to_a_checkpoint_is_told(monkeypatch, tmp_path):
    monkeypatch.setattr(ghrl, "CHECKPOINT", tmp_path)
    with pytest.raises(InvalidInputError, match=r"ships for arm 'hrl'.*hierarchical-master.*checkpoint=runs/hrl"):
        Ghrl("hrl")
    with pytest.raises(InvalidInputError, match=r"ships for arm 'flat'.*hierarchical-flat.*--out runs/flat/flat"):
        Ghrl("flat")


def test_the_named_configurations_exist():
    folder = Path(__file__).parents[3] / "agents" / "hierarchical" / "configs"
    assert {path.stem for path in folder.glob("*.toml")} >= {*Manoeuvre, "drive", "master"}


def test_an_unknown_arm_is_refused(runs):
    with pytest.raises(InvalidInputError, match=r"setting 'arm': expected one of .*'ghrl-r'.*, got 'ghrl-q'"):
        make_agent(ENTRY, {"arm": "ghrl-q", "checkpoint": str(runs)})


@pytest.mark.parametrize("name", ["master", "flat"])
def test_a_damaged_file_is_one_clear_error(runs, tmp_path, name):
    shutil.copytree(runs, tmp_path / "runs")
    (tmp_path / "runs" / name / WEIGHTS).write_bytes(b"nothing of the kind")
    with pytest.raises(InvalidInputError, match=f"{name}/best.safetensors' is no"):
        Ghrl("flat" if name == "flat" else "ghrl", tmp_path / "runs")


def test_sub_policies_of_different_states_do_not_go_together(runs, tmp_path):
    shutil.copytree(runs, tmp_path / "runs")
    other = SubPolicyConfig(state=TWIN.model_copy(update={"localization": "es-ekf"}))
    (tmp_path / "runs" / "left" / CONFIG).write_text(as_toml(other))
    with pytest.raises(InvalidInputError, match=r"'lane' has vision 'none', localization 'truth'.*'left'.*'es-ekf'"):
        read_sub_policies(tmp_path / "runs")


def test_a_policy_for_another_manoeuvre_is_refused(runs, tmp_path):
    shutil.copytree(runs, tmp_path / "runs")
    shutil.copy(runs / "braking" / WEIGHTS, tmp_path / "runs" / "lane" / WEIGHTS)
    with pytest.raises(InvalidInputError, match=r"lane/best.safetensors': expected a policy of \d+ inputs"):
        read_sub_policies(tmp_path / "runs")


def test_a_master_is_read_as_it_was_written(runs):
    master = read_master(runs / "master" / WEIGHTS)
    assert master.manner.state == TWIN
    again = read_master(runs / "master" / WEIGHTS)
    assert all(a.equal(b) for a, b in zip(master.state_dict().values(), again.state_dict().values(), strict=True))
    with pytest.raises(InvalidInputError, match="no master"):
        read_master(runs / "nowhere")


def test_records_tell_checkpoints_and_rules_apart(runs, tmp_path):
    shutil.copytree(runs, tmp_path / "other")
    write = tmp_path / "other" / "flat" / WEIGHTS
    write.write_bytes((runs / "flat" / WEIGHTS).read_bytes())
    same = agent_info(Ghrl("flat", tmp_path / "other"), ENTRY).files_sha256
    assert same == agent_info(Ghrl("flat", runs), ENTRY).files_sha256
    assert same != agent_info(Ghrl("ghrl", runs), ENTRY).files_sha256
