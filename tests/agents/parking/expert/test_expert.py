"""The expert parks, forwards and aligned, where nothing moves, and among karts and pedestrians."""

from __future__ import annotations

import numpy as np
import pytest

from dohyo.agents.parking.expert.expert import Expert
from dohyo.agents.parking.expert.scene import scene_of
from dohyo.agents.parking.training.guided import GuidedVectorEnv
from dohyo.sumo_networks.parking.generate import Scene
from dohyo.sumo_networks.parking.rules import JUDGED
from dohyo.sumo_networks.parking.tables import WALK_SPEED, WALK_X, WALK_Y
from dohyo.sumo_networks.parking.vector_env import Level

SEEDS = [0, 1, 2]


def driven(scene: Scene, karts: int = 1) -> GuidedVectorEnv:
    """Three lots in which experts have driven to the end."""
    lots = GuidedVectorEnv(len(SEEDS), [Level(scene, JUDGED)], karts)
    lots.reset(seed=[seed for seed in SEEDS for _ in range(karts)])
    while lots.running.any():
        actions, known = lots.expert_actions(lots.running)
        assert (known == lots.running).all()
        assert lots.action_space.contains(actions)  # no reverse torque
        lots.step(actions)
    return lots


@pytest.mark.parametrize(
    ("scene", "karts"),
    [(Scene.SIMPLE, 1), (Scene.COMPLEX, 1), (Scene.PARALLEL, 1), (Scene.ANGLED, 1), (Scene.COMPLEX, 3)],
)
def test_the_expert_parks_aligned(scene, karts):
    results = driven(scene, karts).world.results()
    assert results.aligned.all()
    assert (results.shunts == 0).all()


def test_the_expert_waits_for_pedestrians_and_sees_them_move():
    lots = driven(Scene.PEDESTRIANS)
    assert lots.world.results().success.all()
    before, walkers = scene_of(lots.world.view(0), 0).moving, lots.world.view(0).walkers
    assert np.allclose(before[:, :2], walkers[:, [WALK_X, WALK_Y]])
    assert np.allclose(np.hypot(*before[:, 5:].T), walkers[:, WALK_SPEED])


def test_an_expert_without_any_way_goes_on_a_bold_one():
    lots = GuidedVectorEnv(1, [Level(Scene.SIMPLE, JUDGED)])
    lots.reset(seed=[0])
    scene = scene_of(lots.world.view(0), 0)
    spot = scene.spot
    blocked = scene._replace(fixed=np.array([[spot[0], spot[1], 0.0, 4.0, 4.0]]))
    expert = Expert()
    expert.act(lots.world.view(0).karts[0], blocked)
    assert np.allclose(expert.path[-1, 2] % (2 * np.pi), spot[2])
