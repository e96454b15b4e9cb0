"""The learned predictor: the network of `network.py` in onnxruntime, on one thread."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dohyo.agents.learning.policies.session import session_from
from dohyo.agents.mcts.predictors.described import SHAPES, described
from dohyo.agents.mcts.predictors.features import features
from dohyo.agents.planning.prediction import NEAREST, STEPS, Forecast, constant_velocity
from dohyo.agents.planning.scene import Scene
from dohyo.sumo_networks.arrays import Float32Array, FloatArray
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.geometry import wrap_angle

SHIPPED = Path(__file__).with_name("checkpoints") / "motion.onnx"
_TICKS = 5


class Learned:
    """Poses from the network every 0.5 s, linear in between; actors beyond the nearest 30 keep their velocity.

    Attributes:
        session: The network.
    """

    def __init__(self, path: str | Path = SHIPPED) -> None:
        self.session = session_from(Path(path), "predictor")
        inputs = {one.name: tuple(one.shape[1:]) for one in self.session.get_inputs()}
        if inputs != SHAPES:
            raise InvalidInputError(f"'{path}' is no predictor: expected the inputs {dict(SHAPES)}, got {inputs}")

    def predict(self, scene: Scene) -> Forecast:
        """See the class."""
        seen = min(len(scene.actors), NEAREST)
        poses = self.poses(scene).astype(np.float64)
        ego = dense(np.zeros((1, 3)), poses[:1])[0]
        actors = constant_velocity(scene)
        start = np.column_stack([scene.actors.position, scene.actors.heading])[:seen]
        actors[:seen] = dense(start, poses[1:])
        return Forecast(actors=actors, ego=ego)

    def poses(self, scene: Scene) -> Float32Array:
        """(1 + N, 16, 3) output of the network, every 0.5 s from 0.5 s on: the ego and its nearest N, 30 at most."""
        inputs = {name: array[None] for name, array in described(features(scene)).items()}
        out: Float32Array = self.session.run(None, inputs)[0][0]
        return out


def dense(start: FloatArray, poses: FloatArray) -> FloatArray:
    """(N, 81, 3) poses every 0.1 s from the present ones, (N, 3), and those every 0.5 s, (N, 16, 3)."""
    knots = np.concatenate([start[:, None], poses], axis=1)
    step = np.diff(knots, axis=1)
    step[:, :, 2] = wrap_angle(step[:, :, 2])
    share = (np.arange(_TICKS) / _TICKS)[None, None, :, None]
    out = np.empty((len(start), STEPS, 3))
    out[:, :-1] = (knots[:, :-1, None] + share * step[:, :, None]).reshape(len(start), STEPS - 1, 3)
    out[:, -1] = knots[:, -1]
    out[:, :, 2] = wrap_angle(out[:, :, 2])
    return out
