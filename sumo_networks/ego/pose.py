"""Pose: the place and velocity of an ego whose vehicle is simulated elsewhere, and the check that it is plausible."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from gymnasium.spaces import Box

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.ego.control import CONTROLS, Control, InvalidActionError
from dohyo.sumo_networks.geometry import wrap
from dohyo.sumo_networks.world import World

FASTEST_MPS = 60.0
SLACK_M = 0.5
"""Distance by which a place may differ from what the velocities say after one tick."""
SLACK_MPS2 = 10.0
"""Acceleration that velocities at the ends of a longer time may have missed."""
MOST_TURN_RADPS = 2.0 * math.pi
_FARTHEST = 1e7


class ImplausiblePoseError(InvalidActionError):
    """No vehicle can move so from the pose before."""


class Pose(NamedTuple):
    """Place and velocity of a vehicle, network frame.

    Attributes:
        x: x of the centre of the box, m.
        y: y of the centre of the box, m.
        heading: rad, counter-clockwise from +x.
        velocity_x: m/s.
        velocity_y: m/s.
    """

    x: float
    y: float
    heading: float
    velocity_x: float
    velocity_y: float

    @property
    def speed(self) -> float:
        """Speed along the heading, m/s; 0 for a vehicle that moves backwards."""
        along = self.velocity_x * math.cos(self.heading) + self.velocity_y * math.sin(self.heading)
        return max(along, 0.0)

    def after(self, seconds: float) -> Pose:
        """Pose after a time [s] at the same velocity."""
        return self._replace(x=self.x + self.velocity_x * seconds, y=self.y + self.velocity_y * seconds)


class PoseControl(Control):
    """(5,) x, y [m] of the box centre, heading [rad] and velocity x, y [m/s] after the tick, in the network's frame."""

    space = Box(-_FARTHEST, _FARTHEST, (5,), np.float64)

    def pose(self, action: object) -> Pose:
        """Pose after the tick.

        Raises:
            InvalidActionError: The action has a wrong shape or type, or is not finite.
        """
        return Pose(*self.checked(action).tolist())

    def repeated(self, action: FloatArray) -> FloatArray:
        """The vehicle goes on at its velocity."""
        return np.array(Pose(*action.tolist()).after(self.dt))

    def _command(self, action: FloatArray, world: World, ego: int) -> tuple[float, float]:
        return 0.0, 0.0


WORLD_CONTROLS = {**CONTROLS, "pose": PoseControl}
"""Control interfaces of drivers in live worlds. Evaluations have no `pose`, since it has no limits of a vehicle."""


def check_plausible(before: Pose, after: Pose, seconds: float) -> None:
    """Refuses a motion that no vehicle makes.

    Args:
        before: Pose at the beginning.
        after: Pose at the end.
        seconds: Time between the two, s.

    Raises:
        ImplausiblePoseError: The vehicle is too fast, turns too fast, or is not where its velocities lead.
    """
    speed = math.hypot(after.velocity_x, after.velocity_y)
    if speed > FASTEST_MPS:
        raise ImplausiblePoseError(f"expected at most {FASTEST_MPS:g} m/s, got {speed:.1f} m/s")
    turn = abs(wrap(after.heading - before.heading))
    if turn > MOST_TURN_RADPS * seconds:
        raise ImplausiblePoseError(
            f"expected a turn of at most {MOST_TURN_RADPS * seconds:.2f} rad, got {turn:.2f} rad"
        )
    x = before.x + 0.5 * (before.velocity_x + after.velocity_x) * seconds
    y = before.y + 0.5 * (before.velocity_y + after.velocity_y) * seconds
    away, slack = math.hypot(after.x - x, after.y - y), SLACK_M + 0.5 * SLACK_MPS2 * seconds * seconds
    if away > slack:
        raise ImplausiblePoseError(
            f"expected a place within {slack:.2f} m of ({x:.2f}, {y:.2f}), where the velocities before and after lead "
            f"in {seconds:.1f} s, got ({after.x:.2f}, {after.y:.2f}), {away:.1f} m from there"
        )
