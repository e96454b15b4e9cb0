"""Moments: those of all rows so far, and policies whose observations they normalise."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from dohyo.agents.learning.networks.moments import LEAST_SCALE, Moments
from dohyo.agents.learning.networks.policy import FARTHEST, Actor
from tests.agents.learning.algorithms.test_ppo import learner, seen
from tests.agents.learning.problems import Point

torch.set_num_threads(1)  # more are slower wherever the cores are busy

rows = st.lists(st.floats(-100, 100, width=32), min_size=1, max_size=20)


@given(st.lists(rows, min_size=1, max_size=5))
def test_moments_in_parts_are_those_of_the_whole(parts):
    moments = Moments(1)
    for part in parts:
        moments.add(torch.tensor(part)[:, None])
    whole = np.concatenate(parts).astype(np.float64)
    assert moments.count == len(whole)
    assert moments.mean.numpy() == pytest.approx(whole.mean(), abs=1e-6)
    assert moments.scale.numpy() == pytest.approx(max(whole.std(), LEAST_SCALE), rel=1e-6)


def test_moments_can_be_put_back():
    one, other = Moments(2), Moments(2)
    one.add(torch.rand(30, 2))
    other.restore(one.state())
    for moments in (one, other):
        moments.add(torch.ones(5, 2))
    assert torch.equal(one.mean, other.mean)
    assert torch.equal(one.scale, other.scale)


def test_policies_of_normalised_observations_see_them_at_unit_scale():
    ppo = learner(Point(), normalised=True)
    assert ppo.actor.scale.tolist() == [1.0, 1.0]
    batch = ppo.collect()
    ppo.round()
    before = seen(batch).reshape(-1, 2)
    assert ppo.actor.shift.numpy() != pytest.approx(0.0, abs=1e-3)
    assert ppo.actor.scale[1] == pytest.approx(float(before[:, 1].std()), rel=0.3)
    assert ppo._value.scale.tolist() == ppo.actor.scale.tolist()


def test_what_is_far_from_all_that_was_seen_does_not_drown_the_rest():
    actor = Actor(2, -torch.ones(1), torch.ones(1), (8,))
    actor.normalise(torch.zeros(2), torch.tensor([1.0, 0.05]))
    odd, bound = torch.tensor([[0.3, 500.0]]), torch.tensor([[0.3, FARTHEST * 0.05]])
    assert torch.equal(actor(odd), actor(bound))
