"""PolicyAgent: an exported policy drives, with the frames and the repeated actions that it was trained with."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
import pytest
import torch
from gymnasium.spaces import Box, Dict

from dohyo.agents.learning.policies.export import export
from dohyo.agents.learning.policies.policy_agent import AsControl, Frames, PolicyAgent
from dohyo.agents.learning.tasks.environments import FrameStack
from dohyo.evaluation.agent import agent_info, make_agent
from dohyo.evaluation.records.specifications import Status
from dohyo.evaluation.running.run import run_benchmark
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.scenario import Mission, Place
from tests.agents.learning.drivers import Chooser, Choosing, Pilot, Seeing, SmallView
from tests.agents.learning.problems import Sign

STACKED = Dict(view=Box(0, 255, (6, 64, 64), np.uint8), speed=Box(0.0, 100.0, (1,)))
MISSION = Mission(name="ego", start=Place(lane="a_0", position_m=1.0), goal=Place(lane="b_0", position_m=1.0))


@pytest.fixture(scope="module")
def pilot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    torch.manual_seed(0)
    path = tmp_path_factory.mktemp("pilot") / "best"
    export(Pilot(frames=2), STACKED, path, {})
    return path.with_suffix(".onnx")


@pytest.fixture(scope="module")
def chooser(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("chooser") / "best"
    export(Chooser(), SmallView.space, path, {})
    return path.with_suffix(".onnx")


def seen(number: int, speed: float = 0.0) -> dict[str, np.ndarray]:
    """An observation whose picture has one value."""
    return {
        "speedometer": np.array([speed, 0.0], np.float32),
        "birdseye_rgb": np.full((3, 192, 192), number, np.uint8),
    }


def test_a_policy_drives_a_benchmark(pilot: Path, tmp_path: Path) -> None:
    result = run_benchmark(
        "quickstart",
        "tests.agents.learning.drivers:Seeing",
        settings={"policy": str(pilot)},
        seeds=[0],
        only=["right-to-south"],
        out=tmp_path,
    )
    (ego,) = result.records[0].egos
    assert ego.status in (Status.PERFECT, Status.COMPLETED)
    assert ego.failure is None
    assert (ego.agent.track, ego.agent.control) == ("privileged", "lane_command")


def test_its_actions_are_those_of_the_module_on_stacked_pictures(pilot: Path) -> None:
    torch.manual_seed(0)
    module, agent = Pilot(frames=2), Seeing(str(pilot))
    agent.warm_up()
    agent.reset(MISSION, 0)
    stacks = [(10, 10), (10, 10), (10, 30), (10, 30), (30, 50)]  # decisions at ticks 0, 2 and 4
    for tick, (older, newer) in enumerate(stacks):
        action = agent.act(seen(10 * (tick + 1), speed=5.0))
        view = np.concatenate([np.full((3, 64, 64), value, np.uint8) for value in (older, newer)])
        given = {"view": torch.from_numpy(view)[None], "speed": torch.tensor([[5.0]])}
        assert action == pytest.approx(module(given)[0].detach().numpy(), abs=1e-5)


def test_an_episode_knows_nothing_of_the_one_before(pilot: Path) -> None:
    agent, fresh = Seeing(str(pilot)), Seeing(str(pilot))
    for one in (agent, fresh):
        one.reset(MISSION, 0)
    agent.act(seen(200))
    agent.reset(MISSION, 1)
    assert agent.explain() is None
    assert (agent.act(seen(7)) == fresh.act(seen(7))).all()
    assert agent.explain() == fresh.explain()


def test_a_discrete_policy_chooses_rows_of_a_table(chooser: Path) -> None:
    agent = Choosing(str(chooser))
    agent.reset(MISSION, 0)
    assert [agent.act(seen(0, speed))[0] for speed in (0.0, 5.9, 6.1)] == [6.0, 6.0, 0.0]


def test_another_policy_is_another_agent(pilot: Path, tmp_path: Path) -> None:
    torch.manual_seed(1)
    export(Pilot(frames=2), STACKED, tmp_path / "other", {})
    entry = "tests.agents.learning.drivers:Seeing"
    digests = [
        agent_info(make_agent(entry, {"policy": str(path)}), entry).files_sha256
        for path in (pilot, tmp_path / "other.onnx", pilot)
    ]
    assert digests[0] == digests[2] != digests[1]


def test_frames_are_stacked_along_the_channels_oldest_first() -> None:
    frames = Frames(Dict(view=Box(0, 255, (1, 1, 2), np.uint8), speed=Box(0.0, 1.0, (1,))), 3)
    assert frames.space["view"] == Box(0, 255, (3, 1, 2), np.uint8)
    assert frames.space["speed"].shape == (1,)
    shown = []
    for number in (1, 2, 3, 4):
        stacked = frames.stacked({"view": np.full((1, 1, 2), number, np.uint8), "speed": np.zeros(1, np.float32)})
        assert frames.space["view"].contains(stacked["view"])
        shown.append(stacked["view"][:, 0, 0].tolist())
    assert shown == [[1, 1, 1], [1, 1, 2], [1, 2, 3], [2, 3, 4]]


def test_frames_are_those_that_a_learner_sees() -> None:
    task = Sign()
    environments = FrameStack(task.make_environments(1, processes=False), 3)
    frames = Frames(task.observation_space, 3)
    env = task.make_env(0)
    assert frames.space == environments.single_observation_space
    try:
        learner, own = environments.reset(seed=[5])[0], env.reset(seed=5)[0]
        for step in range(5):
            stacked = frames.stacked(own)
            assert all((stacked[name] == learner[name][0]).all() for name in frames.space), step
            learner, own = environments.step(np.array([0]))[0], env.step(0)[0]
    finally:
        environments.close()


def test_what_does_not_fit_is_refused(pilot: Path, chooser: Path, tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match=r"no policy '.*none\.onnx'"):
        Seeing(str(tmp_path / "none.onnx"))
    with pytest.raises(InvalidInputError, match=r"'view' to be uint8 \(6, 64, 64\), got uint8 \(3, 64, 64\)"):
        Choosing(str(pilot))
    (tmp_path / "torn.onnx").write_bytes(b"torn")
    with pytest.raises(InvalidInputError, match="is no ONNX model"):
        Seeing(str(tmp_path / "torn.onnx"))
    model = onnx.load(chooser)
    model.graph.output[0].name = model.graph.node[-1].output[0] = "choice"
    onnx.save(model, tmp_path / "named.onnx")
    with pytest.raises(InvalidInputError, match="expected the output 'action', got choice"):
        Choosing(str(tmp_path / "named.onnx"))

    class Blind(SmallView):
        space = Dict(view=Box(0, 255, (3, 64, 64), np.uint8))

    with pytest.raises(InvalidInputError, match="needs the observation 'speed', there is view"):
        PolicyAgent("blind", chooser, Blind(), AsControl("lane_command"))
    with pytest.raises(InvalidInputError, match="at least 1 frame and tick, got 0 and 1"):
        PolicyAgent("none", chooser, SmallView(), AsControl("lane_command"), frames=0)
