"""Takeovers: who drives when, and pedals as acceleration."""

from __future__ import annotations

from itertools import groupby
from pathlib import Path

import numpy as np
import pytest

from dohyo.agents.priboot.priboot import Priboot
from dohyo.agents.priboot.recording.record import record_episode
from dohyo.agents.priboot.recording.scenarios import MomentRequest, scenario
from dohyo.agents.priboot.recording.takeover import DEMONSTRATOR_S, LEARNER_S, Takeovers, accelerated
from dohyo.evaluation.agent import Observation
from dohyo.sumo_networks.units import TICK_S
from tests.agents.driving import drive, observed, speeds
from tests.agents.priboot.test_priboot import policy
from tests.worlds import straight_road

ROAD = straight_road().with_ego(x=50.0, speed=5.0)
ASKED = np.array([0.25, 0.5])


def test_learner_and_demonstrator_drive_in_turn(tmp_path: Path) -> None:
    learner = Priboot(policy=policy(tmp_path, 0.0))
    takeovers = Takeovers(learner, ROAD.mission, np.random.default_rng(0))
    seen, stretches = observed(learner, ROAD.world()), []
    for _ in range(1000):
        action = takeovers.disturbed(ASKED, 5.0, seen)
        stretches.append(takeovers.active)
        assert (action[0] < -1.0) if takeovers.active else (action is ASKED), "the learner's waypoints stand"
    turns = [(active, len(list(group)) * TICK_S) for active, group in groupby(stretches)][:-1]
    assert len(turns) > 5
    assert not turns[0][0], "the demonstrator begins"
    for active, lasts in turns:
        low, high = LEARNER_S if active else DEMONSTRATOR_S
        assert low - TICK_S <= lasts <= high + TICK_S


class Accelerating(Priboot):
    """The same driver, whose pedals are asked for as acceleration."""

    spec = Priboot.spec.model_copy(update={"control": "acceleration_steering"})

    def act(self, observation: Observation) -> np.ndarray:
        return accelerated(super().act(observation), float(observation["speedometer"][0]))


@pytest.mark.parametrize("wanted", [0.0, 8.0], ids=["brakes", "accelerates"])
def test_pedals_drive_as_the_acceleration_that_they_give(tmp_path: Path, wanted: float) -> None:
    file = policy(tmp_path, wanted)
    ours, theirs = (speeds(drive(kind(policy=file), ROAD, 3.0)) for kind in (Accelerating, Priboot))
    assert ours == pytest.approx(theirs, abs=0.1)
    assert abs(theirs[-1] - theirs[0]) > 2.0


@pytest.mark.slow
def test_of_the_learners_drives_only_what_comes_after_is_recorded(tmp_path: Path) -> None:
    learner = str(policy(tmp_path, 0.0))
    order = MomentRequest(samples=1, egos=2, every_s=0.5, episode_s=20.0, learner=learner)
    alone, taken_over = record_episode(scenario(order, "town-train", 0), order)
    assert 0 < len(taken_over) < len(alone)
