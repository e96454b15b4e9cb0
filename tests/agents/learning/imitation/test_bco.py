"""BCO: the actions between two observations of a world whose dynamics are known."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from dohyo.agents.learning.algorithms.ppo import Ppo
from dohyo.agents.learning.algorithms.ppo_config import PpoConfig
from dohyo.agents.learning.experience.collector import Collector
from dohyo.agents.learning.experience.demonstrations import record_demonstrations
from dohyo.agents.learning.imitation.bco import Bco, BcoConfig, InverseDynamics, InverseDynamicsConfig
from dohyo.agents.learning.tasks.task import named
from tests.agents.learning.problems import STEP, Point
from tests.agents.learning.transitions import ACTIONS, CPU, MOVES, OBSERVATIONS, experience, homeward, transitions


def test_it_finds_the_actions_of_demonstrations_that_hide_them():
    torch.manual_seed(0)
    model = InverseDynamics(OBSERVATIONS, ACTIONS, InverseDynamicsConfig(hidden=(64,), learning_rate=5e-3), CPU)
    model.fit(experience(2000))
    hidden = homeward(100)
    expected = hidden["action"].clone()
    hidden["action"] = torch.zeros_like(expected)
    found = model.label(hidden)
    assert (found["action"] - expected).abs().mean() < 0.1, "of actions up to 2"
    assert not hidden["action"].any(), "the demonstrations themselves stay"


def test_it_finds_discrete_actions():
    torch.manual_seed(0)
    moves, places = torch.randint(4, (800,)), torch.rand(800, 2)
    model = InverseDynamics(OBSERVATIONS, MOVES, InverseDynamicsConfig(hidden=(32,), learning_rate=1e-2), CPU)
    model.fit(transitions(places, moves))
    hidden = transitions(torch.rand(100, 2), torch.arange(100) % 4)
    assert (model.label(hidden)["action"] == torch.arange(100) % 4).float().mean() > 0.97


def test_the_likelihood_by_hand():
    """A standard normal distribution in [-1, 1]^2 around the middle of the action space."""
    model = InverseDynamics(OBSERVATIONS, ACTIONS, InverseDynamicsConfig(), CPU)
    torch.nn.init.zeros_(model._body[-1].weight)
    torch.nn.init.zeros_(model._body[-1].bias)
    row = transitions(torch.zeros(1, 2), torch.zeros(1, 2))
    found = model.distribution(row).log_prob(torch.tensor([[1.0, 0.5]]))
    assert found.item() == pytest.approx(-0.5 * (1.0 + 0.25) - math.log(2.0 * math.pi), rel=1e-5)


def test_a_policy_begins_from_observations_alone_as_their_expert(tmp_path):
    torch.manual_seed(0)
    task, cpu = Point(), torch.device("cpu")
    seen = record_demonstrations(task, tmp_path, 6, expert="steps to the middle").transitions()
    del seen["action"]
    inverse = InverseDynamicsConfig(hidden=(32,), learning_rate=1e-2, epochs=20)
    config = BcoConfig(steps=800, inverse=inverse, loss="huber", learning_rate=1e-2)
    cloning = Bco(seen, named(task.observation_space), task.action_space, config, cpu)
    collector = Collector(task.make_environments(2, processes=False), task, 0)
    ppo = Ppo(task, collector, PpoConfig(hidden=(16, 16)), cpu, cloning=cloning)
    ppo.begin()
    assert collector.steps == 800
    for place in (-1.0, -0.5, 0.1, 0.6):
        expected = np.clip(-place, -STEP, STEP)
        assert ppo.actor.act(np.array([place, 0.3], np.float32)) == pytest.approx(expected, abs=0.4 * STEP)
