"""Observation of a policy: what the ego sees, the route's next points, its last speeds and steering angles.

What it sees is a camera's picture (`PictureView`), or, for the twin without pixels, the exact state (`StateView`). The
sensors of the first are of the track "map", those of the second privileged.
"""

from __future__ import annotations

from collections import deque
from functools import cached_property
from typing import Final, Literal

import numpy as np
from gymnasium.spaces import Box, Dict

from dohyo.agents.endless_driving.config import View
from dohyo.agents.learning.policies.policy_agent import ActionDecoder, SensorEncoder
from dohyo.agents.learning.tasks.task import Array
from dohyo.evaluation.agent import Mission, Observation
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.ego.dynamics import VehicleParameters
from dohyo.sumo_networks.sensors import CameraConfig
from dohyo.sumo_networks.world import ActorKind, LightState

PICTURE, STATE, WAYPOINTS, MEASUREMENTS = "camera", "state", "waypoints", "measurements"
POINTS, SPACING_M, FAR_M = 10, 2, 20.0
"""Waypoints: their number, their distance along the route, and the distance that counts as 1."""
OBJECTS, OBJECT_NUMBERS, NEAR_M = 6, 7, 30.0
STATE_NUMBERS: Final = OBJECTS * OBJECT_NUMBERS + 4
ACTION_REPEAT: Final = 2
"""Ticks of every decision."""
CAMERAS: Final = {64: "camera_64", 256: "camera_rgb"}
"""Camera by the side of its picture, pixels; the second has the thesis's size."""
MAX_STEERING = VehicleParameters().max_steering


class EgoView(SensorEncoder):
    """Waypoints and measurements, which both views have.

    Attributes:
        space: Of one result.
    """

    sensors: tuple[str, ...] = ("speedometer", "route")

    def __init__(self, max_speed: float, history: int) -> None:
        """Prepares.

        Args:
            max_speed: Speed that counts as 1, m/s.
            history: Decisions whose measurements are seen, the last one included.
        """
        self._max_speed, self._history = max_speed, history
        self._measured: deque[tuple[float, float]] = deque(maxlen=ACTION_REPEAT * (history - 1) + 1)

    @cached_property
    def space(self) -> Dict:  # type: ignore[override]
        """See the class; names are sorted, as gymnasium sorts them."""
        vectors = {WAYPOINTS: 2 * POINTS, MEASUREMENTS: 2 * self._history}
        return Dict(
            {
                **self._seen_space(),
                **{name: Box(-np.inf, np.inf, (size,), np.float32) for name, size in vectors.items()},
            }
        )

    def reset(self, mission: Mission, seed: int) -> None:
        """See `SensorEncoder`."""
        self._measured.clear()

    def encode(self, observation: Observation) -> dict[str, Array]:
        """See `SensorEncoder`."""
        speed, steering = observation["speedometer"].tolist()
        now = speed / self._max_speed, steering / MAX_STEERING
        self._measured.extend([now] * (1 if self._measured else self._measured.maxlen or 1))
        measured = np.array([*self._measured][::ACTION_REPEAT], np.float32).ravel()
        points = observation["route"][SPACING_M : SPACING_M * (POINTS + 1) : SPACING_M, :2] / np.float32(FAR_M)
        return {**self._seen(observation), WAYPOINTS: points.ravel(), MEASUREMENTS: measured}

    def _seen_space(self) -> dict[str, Box]:
        raise NotImplementedError

    def _seen(self, observation: Observation) -> dict[str, Array]:
        raise NotImplementedError


class PictureView(EgoView):
    """The picture of a front camera, (3, side, side)."""

    track: Literal["sensors", "map", "privileged"] = "map"

    def __init__(self, max_speed: float, history: int, side: int = 64) -> None:
        """See `EgoView`; `side` is one of `CAMERAS`."""
        super().__init__(max_speed, history)
        self._camera, self._side = CAMERAS[side], side
        self.sensors = (*EgoView.sensors, self._camera)

    def _seen_space(self) -> dict[str, Box]:
        return {PICTURE: CameraConfig(name=PICTURE, width=self._side, height=self._side).space}

    def _seen(self, observation: Observation) -> dict[str, Array]:
        return {PICTURE: observation[self._camera]}


class StateView(EgoView):
    """The exact state, (46,): the nearest objects ahead and beside, and the next junction."""

    track: Literal["sensors", "map", "privileged"] = "privileged"
    sensors = (*EgoView.sensors, "objects", "junctions_ahead")

    def _seen_space(self) -> dict[str, Box]:
        return {STATE: Box(-np.inf, np.inf, (STATE_NUMBERS,), np.float32)}

    def _seen(self, observation: Observation) -> dict[str, Array]:
        objects = objects_ahead(observation["objects"])
        return {STATE: np.concatenate([objects.ravel(), next_junction(observation["junctions_ahead"])])}


def objects_ahead(objects: Float32Array) -> Float32Array:
    """(6, 7) the nearest objects that are not behind: there, on foot, x, y, cosine, sine, speed; unused rows are 0.

    Args:
        objects: (48, 8) of the sensor `objects`.
    """
    near = (objects[:, 0] >= 0) & (objects[:, 1] > -3.0) & (np.hypot(objects[:, 1], objects[:, 2]) < NEAR_M)
    rows = objects[near][:OBJECTS]
    out = np.zeros((OBJECTS, OBJECT_NUMBERS), np.float32)
    out[: len(rows), 0] = 1.0
    out[: len(rows), 1] = rows[:, 0] == ActorKind.PEDESTRIAN
    out[: len(rows), 2:4] = rows[:, 1:3] / NEAR_M
    out[: len(rows), 4], out[: len(rows), 5] = np.cos(rows[:, 3]), np.sin(rows[:, 3])
    out[: len(rows), 6] = rows[:, 4] / 10.0
    return out


def next_junction(junctions: Float32Array) -> Float32Array:
    """(4,) nearness of the next stop line within 30 m (1: there), whether it is closed, is open, has a stop sign.

    Args:
        junctions: (4, 4) of the sensor `junctions_ahead`.
    """
    distance, _, signal, control = junctions[int(junctions[0, 0] < 0.0)].tolist()
    if distance >= NEAR_M:
        return np.zeros(4, np.float32)
    closed = signal in (LightState.RED, LightState.YELLOW)
    return np.array([1.0 - distance / NEAR_M, closed, signal == LightState.GREEN, control == 2], np.float32)


class TargetSpeed(ActionDecoder):
    """(2,) in [-1, 1]: target speed from 0 to `max_speed`, and steering -> action of `target_speed_steering`.

    A squashed Gaussian comes near -1 and never there, so a policy that wants to stand would creep.
    """

    def __init__(self, max_speed: float, stand_below: float = 0.0) -> None:
        """Prepares.

        Args:
            max_speed: Target speed of an action of 1, m/s.
            stand_below: A target speed below it, m/s, means 0.
        """
        self.control, self._max_speed, self._stand_below = "target_speed_steering", max_speed, stand_below

    def decode(self, action: Array, observation: Observation) -> Array:
        """See `ActionDecoder`."""
        speed = np.float32((action[0] + 1.0) / 2.0 * self._max_speed)
        return np.array([speed if speed >= self._stand_below else 0.0, action[1]], np.float32)


def make_view(view: View, max_speed: float, history: int, side: int = 64) -> EgoView:
    """The view of a name, see `EgoView`; `side` is the picture's, pixels."""
    return PictureView(max_speed, history, side) if view == "picture" else StateView(max_speed, history)
