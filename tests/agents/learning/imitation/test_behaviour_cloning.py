"""Behavioural cloning: its losses by hand, and a policy of recorded episodes."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import pytest
import torch
from gymnasium.spaces import Box, Discrete

from dohyo.agents.learning.experience.demonstrations import record_demonstrations
from dohyo.agents.learning.files.card import digest, read_card
from dohyo.agents.learning.files.report import no_report
from dohyo.agents.learning.imitation.behaviour_cloning import ImitatingPolicy, PolicyConfig, cloning_loss
from dohyo.agents.learning.networks.policy import Actor, actor_for
from dohyo.agents.learning.runs.trainer import TrainRequest
from dohyo.sumo_networks.errors import InvalidInputError
from tests.agents.learning.killed import killed_and_resumed
from tests.agents.learning.problems import BEST_RETURN, Lock, Point
from tests.agents.learning.toys import CLONING, PointCloningConfig

torch.set_num_threads(1)  # more are slower wherever the cores are busy


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("data")
    record_demonstrations(Point(), folder, 10, expert="steps to the middle")
    return folder


def test_a_policy_of_recorded_episodes_drives_as_the_expert(data: Path, tmp_path: Path):
    shipped = CLONING.train(PointCloningConfig(data=data), TrainRequest("cloning", tmp_path, False, no_report))
    with (tmp_path / "metrics.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["return"]]
    assert [row["steps"] for row in rows] == ["200", "400"]
    assert BEST_RETURN >= float(rows[-1]["return"]) > BEST_RETURN - 0.5
    card = read_card(shipped)
    assert (card.subject, card.steps, card.data_sha256) == ("point", 400, digest(data))
    assert card.metrics["return"] == float(rows[-1]["return"])  # type: ignore[index, call-overload]
    assert Actor.load(shipped).act(torch.tensor([0.1, 0.0]).numpy()) == pytest.approx(-0.1, abs=0.05)


def test_a_killed_run_ends_bit_equal_to_one_that_was_not(data: Path, tmp_path: Path):
    settings = [f"data={data}", "steps=40", "evaluate_every=15", "checkpoint_s=1e-9"]
    killed_and_resumed("tests.agents.learning.toys:CLONING", settings, tmp_path)


def test_demonstrations_of_other_spaces_are_refused(tmp_path: Path):
    record_demonstrations(Lock(), tmp_path / "data", 2, expert="reads the dials")
    with pytest.raises(InvalidInputError, match=r"000000\.safetensors': column 'action': expected actions in Box"):
        CLONING.train(
            PointCloningConfig(data=tmp_path / "data"), TrainRequest("cloning", tmp_path / "run", False, no_report)
        )


def actor(actions: Box | Discrete, squashed: bool = False):
    made = actor_for(1, actions, (4,), 0.5, squashed)
    torch.nn.init.zeros_(made.body[-1].weight)
    return made


def test_the_likelihood_of_a_gaussian_by_hand():
    """Mean 0 and deviation 0.5 in [-1, 1]; the action 3 of [-4, 4] is 0.75 there."""
    loss = cloning_loss(actor(Box(-4.0, 4.0, (1,))), torch.zeros(1, 1), torch.tensor([[3.0]]), "likelihood")
    assert loss.item() == pytest.approx(0.5 * (0.75 / 0.5) ** 2 + math.log(0.5 * math.sqrt(2.0 * math.pi)), rel=1e-5)


def test_hubers_loss_by_hand():
    loss = cloning_loss(actor(Box(-4.0, 4.0, (1,))), torch.zeros(1, 1), torch.tensor([[3.0]]), "huber")
    assert loss.item() == pytest.approx(0.75 - 0.5 * 0.1)


def test_the_likelihood_of_a_choice_by_hand():
    loss = cloning_loss(actor(Discrete(4)), torch.zeros(2, 1), torch.tensor([0, 3]), "likelihood")
    assert loss.item() == pytest.approx(math.log(4.0))


def test_a_squashed_policy_learns_actions_inside_its_bounds():
    torch.manual_seed(0)
    made, wanted = actor(Box(-1.0, 1.0, (1,)), squashed=True), torch.full((8, 1), 0.6)
    optimizer = torch.optim.Adam(made.parameters(), lr=0.05)
    for _ in range(100):
        optimizer.zero_grad()
        cloning_loss(made, torch.ones(8, 1), wanted, "likelihood").backward()
        optimizer.step()
    assert made(torch.ones(1, 1)).item() == pytest.approx(0.6, abs=0.05)


def test_hubers_loss_needs_a_mean():
    class Choices(Point):
        action_space = Discrete(3)

    with pytest.raises(InvalidInputError, match="likelihood"):
        ImitatingPolicy(Choices(), PolicyConfig(loss="huber"))
