"""DAgger: it learns its expert, goes on where it was killed, and gives PPO a start."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
import torch
from tensordict import TensorDict
from torch import Tensor, nn

from dohyo.agents.learning.experience.collector import Collector
from dohyo.agents.learning.imitation.behaviour_cloning import Labels
from dohyo.agents.learning.imitation.dagger import Dagger, WarmStart
from dohyo.sumo_networks.errors import InvalidInputError
from tests.agents.learning.algorithms.test_ppo import learner, trained
from tests.agents.learning.killed import killed_and_resumed
from tests.agents.learning.problems import BEST_RETURN, LENGTH, STEP, Point
from tests.agents.learning.toys import POINT, SMALL, PointConfig, PointDaggerConfig

torch.set_num_threads(1)  # more are slower wherever the cores are busy
IMITATING = {"imitated_steps": 2400, "gamma": 0.9, "initial_std": 0.3}
QUICK = PointDaggerConfig().dagger


def test_it_learns_its_expert_and_a_killed_run_goes_on_to_the_bit(tmp_path):
    whole = killed_and_resumed("tests.agents.learning.toys:DAGGER", [], tmp_path)
    with (whole / "evaluations.csv").open() as file:
        first, last = csv.DictReader(file)
    assert float(first["return"]) < -15.0
    assert BEST_RETURN >= float(last["return"]) > BEST_RETURN - 0.5


def test_the_experts_share_of_the_episodes_falls_and_every_step_is_labelled():
    task = Point()
    collector = Collector(task.make_environments(2, processes=False), task, 0)
    dagger = Dagger(task, collector, QUICK, torch.device("cpu"))
    rows = [dagger.round() for _ in range(3)]
    assert [row["expert_share"] for row in rows] == [1.0, 0.5, 0.25]
    assert [row["labels"] for row in rows] == [128, 256, 384]
    assert rows[-1]["loss"] < rows[0]["loss"]


class _Alone(Point):
    has_expert = False


def test_a_task_without_an_expert_is_refused():
    task = _Alone()
    collector = Collector(task.make_environments(1, processes=False), task, 0)
    with pytest.raises(InvalidInputError, match="no expert"):
        Dagger(task, collector, QUICK, torch.device("cpu"))


def test_labels_are_kept_in_the_order_of_time_where_the_expert_gave_one():
    steps = TensorDict(
        {
            "observation": {"x": torch.arange(6.0).reshape(2, 3, 1)},
            "label": torch.arange(6.0).reshape(2, 3, 1) * 10.0,
            "labelled": torch.tensor([[True, False, True], [True, True, False]]),
        },
        [2, 3],
    )
    labels = Labels()
    labels.add(steps)
    assert labels.rows["observation", "x"].flatten().tolist() == [0.0, 3.0, 4.0, 2.0]
    assert labels.rows["label"].flatten().tolist() == [0.0, 30.0, 40.0, 20.0]
    labels.add(steps)
    assert len(labels) == 8


def test_ppo_may_begin_as_the_expert():
    ppo = learner(Point(), **IMITATING)
    assert ppo._collector.steps == 2400
    for place in (-1.0, -0.5, 0.1, 0.6):
        expected = np.clip(-place, -STEP, STEP)
        assert ppo.actor.act(np.array([place, 0.3], np.float32)) == pytest.approx(expected, abs=0.3 * STEP)


def test_the_critic_knows_what_comes():
    """From rest nothing more is lost; from the edge, about what the best loses."""
    ppo = learner(Point(), **IMITATING)
    with torch.no_grad():
        near, far = ppo._value(torch.tensor([[0.0, 0.2], [1.0, 0.0]]))[:, 0].tolist()
    assert far < 0.8 * BEST_RETURN < near


def test_nothing_is_learned_where_the_expert_has_no_opinion(monkeypatch):
    kept: list[Labels] = []
    monkeypatch.setattr(Labels, "fit", lambda self, *arguments: kept.append(self))
    learner(Point(reticent=True), imitated_steps=400)
    places = kept[-1].rows["observation", "observation"][:, 0]
    assert 0 < len(places) < 400
    assert (places < 0).all()


def test_a_run_may_begin_with_imitation(tmp_path: Path):
    settings = SMALL.model_copy(update={"imitated_steps": 960, "normalised": True})
    first, *_ = trained(POINT, PointConfig(steps=1200, evaluate_every=5000, ppo=settings), tmp_path / "run")
    assert int(first["steps"]) == 960
    assert float(first["success"]) == 100.0


class _Seven(nn.Module):
    """A critic that says 7 of everything."""

    def __init__(self) -> None:
        super().__init__()
        self.said = nn.Parameter(torch.tensor(7.0))

    def forward(self, features: Tensor) -> Tensor:
        return self.said.expand(len(features), 1)


def test_a_start_counts_what_would_have_come_after_a_time_limit():
    ppo, task = learner(Point()), Point()
    collector = Collector(task.make_environments(2, processes=False), task, 0)
    start = WarmStart(ppo.actor, _Seven(), lambda seen: torch.cat(list(seen.values()), -1), collector, 0.5, 1.0)
    start._collect(2 * LENGTH, follow=True)
    last = start.labels.rows["observation", "observation"][:, 1] > 1.0 - 1.5 / LENGTH
    assert last.sum() == 4
    assert (start.labels.rows["returns"][last] > 0.5 * 7.0 - 0.5).all()  # the point rests near 0 by then
