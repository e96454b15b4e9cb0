"""Halts: where and for how long an ego is held before what stands in its lane, and what is recorded of it."""

from __future__ import annotations

import numpy as np
import pytest

from dohyo.agents.priboot.priboot import Priboot
from dohyo.agents.priboot.recording.halts import GAP_M, LONGEST_S, TOLD_S, WAIT_S, Halts
from dohyo.agents.priboot.recording.record import record_episode
from dohyo.agents.priboot.recording.scenarios import MomentRequest, scenario
from dohyo.agents.priboot.rules import standing_gap
from dohyo.evaluation.agent import Mission, Observation
from dohyo.sumo_networks.units import TICK_S
from tests.agents.driving import drive, speeds
from tests.worlds import straight_road

CAR_M = 100.0
ROAD = straight_road().with_ego(x=50.0, speed=8.0).with_actor(CAR_M)
SECONDS = 16.0


class Held(Priboot):
    """Asks for an acceleration at all times, and is held."""

    spec = Priboot.spec.model_copy(update={"control": "acceleration_steering"})

    def __init__(self, seed: int, asked: float) -> None:
        super().__init__()
        self.halts, self.asked = Halts(np.random.default_rng(seed)), np.array([asked, 0.0])
        self.gaps: list[float] = []
        self.active: list[bool] = []

    def reset(self, mission: Mission, seed: int) -> None:
        """Nothing is kept."""

    def act(self, observation: Observation) -> np.ndarray:
        self.gaps.append(standing_gap(observation))
        out = self.halts.disturbed(self.asked, float(observation["speedometer"][0]), observation)
        self.active.append(self.halts.active)
        assert (out is self.asked) != self.halts.active, "else its demonstrator drives"
        return out


@pytest.mark.parametrize("seed", range(4))
def test_an_ego_is_held_before_what_stands_and_let_go(seed: int) -> None:
    agent = Held(seed, asked=0.6)
    found = speeds(drive(agent, ROAD, SECONDS))
    stops = int(np.argmax(found < 0.1))
    stood = int(np.argmax(found[stops:] > 0.1)) * TICK_S
    assert GAP_M[0] - 1.5 <= agent.gaps[stops] <= GAP_M[1] + 0.5, "its brake takes a moment"
    assert WAIT_S[0] - 3 * TICK_S <= stood <= WAIT_S[1] + 5 * TICK_S
    first = agent.active.index(True)
    assert not any(agent.active[: first - 1])
    assert not all(agent.active[first:])


def test_a_demonstrator_that_would_not_go_is_held_no_longer() -> None:
    agent = Held(0, asked=-0.5)
    drive(agent, ROAD, SECONDS)
    first = agent.active.index(True)
    held = agent.active[first:].index(False) * TICK_S
    assert LONGEST_S < held < LONGEST_S + 4.0, "braking included"


def test_no_ego_is_held_on_a_free_road() -> None:
    agent = Held(0, asked=0.0)
    drive(agent, straight_road().with_ego(x=50.0, speed=8.0).with_actor(CAR_M, left=3.2), 8.0)
    assert not any(agent.active)


def test_it_may_be_told_to_have_stood_for_long() -> None:
    told = [Halts(np.random.default_rng(seed)).told_s for seed in range(20)]
    assert all(one is not None and 0.0 <= one <= TOLD_S for one in told)
    assert max(one for one in told if one is not None) > TOLD_S / 2


@pytest.mark.slow
def test_those_that_are_held_are_recorded_as_they_go_on() -> None:
    order = MomentRequest(samples=1, egos=3, every_s=0.3, episode_s=60.0, seed=2, obstacles="lanes")
    for moments in record_episode(scenario(order, "district", 0), order)[1:]:
        stands = moments.measurements[:, 0, 0] < 0.01
        goes = moments.waypoints[:, 0, -1, 0] > 2.0
        assert (stands & goes).sum() > 3
