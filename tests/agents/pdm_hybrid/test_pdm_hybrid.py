"""PDM-Hybrid: it drives as PDM-Closed, keeps the beginning of its plan, and learns what comes behind."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import numpy as np
import onnxruntime
import pytest
import torch

from dohyo.agents.experts.pdm import PdmClosed
from dohyo.agents.learning.files.card import read_card
from dohyo.agents.learning.files.report import Report, Reporter, no_report
from dohyo.agents.learning.policies.export import export
from dohyo.agents.learning.runs.trainer import TrainRequest
from dohyo.agents.mcts.predictors import learned as mbappe
from dohyo.agents.mcts.predictors.dataset import Shard
from dohyo.agents.pdm_hybrid.agent import PdmHybrid
from dohyo.agents.pdm_hybrid.network import PlanNetwork
from dohyo.agents.pdm_hybrid.offset import Offset
from dohyo.agents.pdm_hybrid.plans import SPACE, inputs, make_planner
from dohyo.agents.pdm_hybrid.training import OffsetConfig, train
from dohyo.evaluation.agent import Agent
from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.sumo_networks.envs.driving_env import DrivingEnv
from dohyo.sumo_networks.errors import InvalidInputError
from tests.agents.mcts.predictors.scenes import busy, sampled, scene, straight


def drawn_network(folder: Path, planned: bool = True, shift_m: float = 0.0) -> Path:
    """An untrained network, whose poses are shifted to the left."""
    torch.manual_seed(0)
    network = PlanNetwork(planned)
    with torch.no_grad():
        network.layers[-1].bias.view(16, 3)[:, 1] += shift_m / 20.0
    export(network, SPACE, folder / "best", {})
    return folder / "best.onnx"


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Scenes whose ego keeps its speed, whatever stands in its way."""
    folder = tmp_path_factory.mktemp("motion")
    for split, seeds in (("train", range(24)), ("validation", range(30, 36))):
        (folder / split).mkdir()
        shard = Shard.of([sampled(busy(seed, actors=4, lanes=4)) for seed in seeds])
        (folder / split / "a.npz").write_bytes(shard.to_bytes())
    return folder


def trained(data: Path, out: Path, resume: bool = False, report: Reporter = no_report, **more: object) -> Path:
    facts = {"steps": 60, "batch": 8, "validate_every": 20, "learning_rate": 1e-3} | more
    config = OffsetConfig(data=data, tensorboard=False, **facts)  # type: ignore[arg-type]
    return train(config, TrainRequest("pdm-offset", out, resume, report))


def answers(driver: Agent, *others: Agent, ticks: int = 60) -> np.ndarray:
    """(T, agents, 2) actions on the first mission of quickstart, which the first agent drives."""
    scenario = load_benchmark("quickstart").scenarios([0])[0]
    mission, agents, actions = scenario.missions[0], (driver, *others), []
    with closing(DrivingEnv(scenario, driver.spec.sensors, driver.spec.control, reward=None)) as env:
        seen, _ = env.reset()
        for agent in agents:
            agent.reset(mission, 0)
        for _ in range(ticks):
            actions.append([agent.act(seen[mission.name]) for agent in agents])
            seen, *_ = env.step({mission.name: actions[-1][0]})
    return np.array(actions)


def test_a_plan_follows_the_path_and_stops_at_a_closed_line() -> None:
    plan = make_planner().plan_in(scene(lanes=[straight(-20.0, 100.0, on_route=2)], ego_speed=8.0))
    assert plan.shape == (16, 3)
    assert (np.diff(plan[:, 0]) >= 0.0).all()
    assert 20.0 < plan[-1, 0] < 30.0 - 2.0, "the front stops before the line in 30 m"
    assert np.abs(plan[:, 1]).max() < 0.5


def test_two_seconds_of_a_plan_stay_as_they_are(tmp_path: Path) -> None:
    now = busy(0)
    plan = make_planner().plan_in(now)
    policy = drawn_network(tmp_path, shift_m=2.0)
    kept, whole, nothing = (Offset(policy, kept_s=seconds)(now, plan) for seconds in (2.0, 0.0, 8.0))
    np.testing.assert_array_equal(kept[:4], plan[:4])
    np.testing.assert_array_equal(nothing, plan)
    np.testing.assert_allclose(kept[4:], whole[4:])
    assert (np.abs(whole[:, 1] - plan[:, 1] - 2.0) < 1.5).all(), "an untrained network adds little of its own"


def test_it_drives_as_pdm_closed_and_tells_the_corrected_plan(tmp_path: Path) -> None:
    policy = drawn_network(tmp_path, shift_m=5.0)
    closed, hybrid = PdmClosed(), PdmHybrid(policy=policy)  # type: ignore[abstract]
    network = PdmHybrid(policy=policy, kept_s=0.0)  # type: ignore[abstract]
    mine, its, other = np.moveaxis(answers(closed, hybrid, network), 1, 0)
    np.testing.assert_array_equal(mine, its)
    assert np.abs(other - its).max() > 0.1
    told = hybrid.explain()
    assert told is not None
    np.testing.assert_allclose(told["trajectory"][:4], told["kept"][5:25:5], atol=0.011)
    assert np.array(told["trajectory"])[4:, 1].mean() > np.array(told["kept"])[25::5, 1].mean() + 2.0


def test_a_training_learns_and_ends_alike_after_a_kill(data: Path, tmp_path: Path) -> None:
    def killed(now: Report) -> None:
        if now.steps == 33:
            raise KeyboardInterrupt

    whole = trained(data, tmp_path / "whole", checkpoint_s=1e-9)
    with pytest.raises(KeyboardInterrupt):
        trained(data, tmp_path / "parts", report=killed, checkpoint_s=1e-9)
    parts = trained(data, tmp_path / "parts", resume=True)
    assert whole.read_bytes() == parts.read_bytes()
    assert (tmp_path / "whole/metrics.csv").read_text() == (tmp_path / "parts/metrics.csv").read_text()
    first = float((tmp_path / "whole/metrics.csv").read_text().splitlines()[2].split(",")[2] or "nan")
    last = read_card(whole).metrics["validation_ade_m"]  # type: ignore[index]
    assert last < 0.8 * first


@pytest.mark.parametrize("planned", [True, False])
def test_only_a_hybrid_sees_the_plan(data: Path, tmp_path: Path, planned: bool) -> None:
    model = onnxruntime.InferenceSession(str(trained(data, tmp_path, planned=planned, steps=2)))
    assert ("plan" in {one.name for one in model.get_inputs()}) is planned
    now = busy(1)
    plan = make_planner().plan_in(now)
    poses = Offset(tmp_path / "best.onnx", kept_s=0.0)(now, plan)
    network = PlanNetwork(planned)
    assert poses.shape == (16, 3)
    assert set(network.seen) == set(inputs(now, plan)) - (set() if planned else {"plan"})


def test_what_cannot_be_used_is_refused(tmp_path: Path) -> None:
    policy = drawn_network(tmp_path)
    with pytest.raises(InvalidInputError, match=r"expected kept_s from 0 to 8 s, got 9"):
        PdmHybrid(policy=policy, kept_s=9.0)  # type: ignore[abstract]
    with pytest.raises(InvalidInputError, match=r"no policy '/nowhere\.onnx'"):
        PdmHybrid(policy="/nowhere.onnx")  # type: ignore[abstract]
    other = Path(mbappe.SHIPPED)
    with pytest.raises(InvalidInputError, match="is no offset of plans"):
        Offset(other)
