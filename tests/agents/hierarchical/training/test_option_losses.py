"""Option-critic's equations by hand, and a chain whose solution is known."""

from __future__ import annotations

import copy

import numpy as np
import pytest
import torch
from tensordict import TensorDict

from dohyo.agents.hierarchical.options.values import OptionValues, choose
from dohyo.agents.hierarchical.training.option_losses import (
    OptionReplay,
    arrival_value,
    best_value,
    intra_option_loss,
    smdp_target,
    termination_loss,
)
from dohyo.sumo_networks.errors import InvalidInputError

GAMMA = 0.9
NONE_ENDED = torch.tensor([False])


def test_an_options_target_is_what_it_earned_and_the_best_from_where_it_ended():
    # Three ticks that pay 1, 0, 2: 1 + 0.9^2 * 2 = 2.62; then the best of 5 and 7 (9 may not begin): 0.9^3 * 7 = 5.103.
    rewards = torch.tensor([1.0 + GAMMA**2 * 2.0])
    best = best_value(torch.tensor([[5.0, 9.0, 7.0]]), torch.tensor([[True, False, True]]))
    assert smdp_target(rewards, torch.tensor([3.0]), best, NONE_ENDED, GAMMA).item() == pytest.approx(7.723)
    ended = smdp_target(rewards, torch.tensor([3.0]), best, torch.tensor([True]), GAMMA)
    assert ended.item() == pytest.approx(2.62)


def test_arriving_with_an_option_is_worth_going_on_or_choosing_anew():
    value = arrival_value(torch.tensor([4.0]), torch.tensor([0.25]), torch.tensor([8.0]))
    assert value.item() == pytest.approx(0.75 * 4.0 + 0.25 * 8.0)


@pytest.mark.parametrize(
    ("q_option", "best", "cost", "falls"),
    [
        (5.0, 8.0, 0.0, False),  # another one is better: end it
        (8.0, 8.0, 0.0, None),  # as good as the best
        (8.0, 8.0, 0.5, True),  # choosing anew costs something
        (7.8, 8.0, 0.5, True),  # it is worse by less than that
        (7.0, 8.0, 0.5, False),
    ],
)
def test_an_option_ends_the_less_the_better_it_still_is(q_option, best, cost, falls):
    logit = torch.zeros(1, requires_grad=True)
    loss = termination_loss(torch.sigmoid(logit), torch.tensor([q_option]), torch.tensor([best]), cost)
    loss.backward()
    step = -logit.grad.item()
    assert (step < 0) is falls if falls is not None else step == 0.0
    assert step == pytest.approx(-0.25 * (q_option - best + cost))


@pytest.mark.parametrize(("arrived", "likelier"), [(3.0, True), (1.0, False)])
def test_an_action_better_than_its_options_value_becomes_likelier(arrived, likelier):
    log_prob = torch.zeros(1, requires_grad=True)
    intra_option_loss(log_prob, torch.tensor([arrived]), torch.tensor([2.0])).backward()
    assert (-log_prob.grad.item() > 0) is likelier


def test_values_are_learned_through_none_of_the_policy_losses():
    q = torch.zeros(1, requires_grad=True)
    beta, log_prob = torch.full((1,), 0.5, requires_grad=True), torch.zeros(1, requires_grad=True)
    loss = termination_loss(beta, q, q, 0.1) + intra_option_loss(log_prob, q + 1.0, q)
    loss.backward()
    assert q.grad is None


def test_the_best_of_those_that_may_begin_is_chosen():
    q, rng = np.array([1.0, 5.0, 3.0], np.float32), np.random.default_rng(0)
    assert choose(q, np.array([True, True, True]), 0.0, rng) == 1
    assert choose(q, np.array([True, False, True]), 0.0, rng) == 2
    drawn = [choose(q, np.array([True, False, True]), 0.4, rng) for _ in range(5000)]
    assert set(drawn) == {0, 2}
    assert drawn.count(0) / 5000 == pytest.approx(0.2, abs=0.03)
    with pytest.raises(InvalidInputError, match="at least one option"):
        choose(q, np.zeros(3, np.bool_), 0.0, rng)


def test_terminations_are_probabilities_that_begin_near_one_in_ten():
    torch.manual_seed(0)
    _, beta = OptionValues(4, 3, (16,))(torch.randn(50, 4))
    assert beta.shape == (50, 3)
    assert 0.05 < beta.detach().mean().item() < 0.2


def ended(*numbers: int) -> TensorDict:
    n = torch.tensor(numbers, dtype=torch.float32)
    rows = {"state": n[:, None].expand(-1, 2), "option": (n % 2).long(), "total": n, "terminated": n == 4.0}
    return TensorDict(rows, [len(n)])


def test_a_replay_keeps_the_last_and_goes_on_from_its_state():
    replay = OptionReplay(size=3)
    replay.add(ended(0, 1, 2))
    replay.add(ended(3, 4))
    assert len(replay) == 3
    kept = copy.deepcopy(replay.state())
    torch.manual_seed(0)
    batch = replay.sample(200)
    assert set(batch["total"].tolist()) == {2.0, 3.0, 4.0}
    assert torch.equal(batch["state"][:, 0], batch["total"])
    assert torch.equal(batch["terminated"], batch["total"] == 4.0)
    again = OptionReplay(size=3)
    again.restore(kept)
    torch.manual_seed(0)
    assert torch.equal(again.sample(200)["total"], batch["total"])
    for one in (replay, again):
        one.add(ended(5))
    assert set(again.sample(200)["total"].tolist()) == {3.0, 4.0, 5.0}


def test_a_chain_is_solved():
    # Four places: option 0 goes one to the right in one tick, option 1 two in two ticks. Arriving at the right end pays
    # 1 and ends the episode, so that the values from there back are 1, 0.9 and 0.81 whichever option is taken.
    torch.manual_seed(0)
    table = torch.zeros(4, 2, requires_grad=True)
    optimizer = torch.optim.SGD([table], lr=0.5)
    for _ in range(60):
        loss = torch.zeros(())
        for place in range(3):
            for option, ticks in ((0, 1), (1, 2)):
                after = min(place + ticks, 3)
                earned = torch.tensor([GAMMA ** (after - place - 1)]) if after == 3 else torch.zeros(1)
                best = best_value(table[after][None].detach(), torch.ones(1, 2, dtype=torch.bool))
                ended = torch.tensor([after == 3])
                wanted = smdp_target(earned, torch.tensor([float(ticks)]), best, ended, GAMMA)
                loss = loss + (table[place, option] - wanted[0]) ** 2
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    expected = [[GAMMA**2, GAMMA**2], [GAMMA, GAMMA], [1.0, 1.0]]
    assert table[:3].detach().numpy() == pytest.approx(np.array(expected), abs=1e-3)
