"""Acceleration-based controller: FollowerStopper, with gentle reactions to cut-ins and cut-outs.

FollowerStopper drives the target speed while there is room, and less as the gap closes (Stern et al. 2018). A cut-in
shortens the gap at once and would make it brake hard without danger. Recovery then shrinks the envelopes to the actual
gap and lets them grow back. Recovery does not change the safe speed, which allows for a leader's full braking.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from dohyo.sumo_networks.arrays import FloatArray

GAPS_M = (4.5, 5.25, 6.0)
DECELERATIONS_MPS2 = (1.5, 1.0, 0.5)


def follower_stopper(
    target: FloatArray, gap: FloatArray, leader: FloatArray, own: FloatArray, ease: FloatArray
) -> FloatArray:
    """Commanded speed.

    Args:
        target: (N,) speed to drive with room ahead, m/s.
        gap: (N,) m, infinite without a leader.
        leader: (N,) its speed, m/s; ignored without one.
        own: (N,) m/s.
        ease: (N,) factor on the envelopes: 1, less while recovering.

    Returns:
        (N,) m/s, from 0 to the target.

    Source: Stern et al. 2018, Dissipation of stop-and-go waves via control of autonomous vehicles.
    """
    there = np.isfinite(gap)
    ahead = np.where(there, leader, target)
    closing = np.minimum(ahead - own, 0.0)
    near, middle, far = (
        ease * (least + closing**2 / (2 * deceleration))
        for least, deceleration in zip(GAPS_M, DECELERATIONS_MPS2, strict=True)
    )
    slow = np.clip(ahead, 0.0, target)
    room = np.where(there, gap, far + 1.0)
    command = np.where(
        room <= middle,
        slow * (room - near) / (middle - near),
        slow + (target - slow) * (room - middle) / (far - middle),
    )
    return np.where(room <= near, 0.0, np.where(room > far, target, command))


def envelope(gap: FloatArray, leader: FloatArray, own: FloatArray) -> FloatArray:
    """(N,) gap beyond which the target is driven, m; see `follower_stopper`."""
    closing = np.where(np.isfinite(gap), np.minimum(leader - own, 0.0), 0.0)
    return np.asarray(GAPS_M[2] + closing**2 / (2 * DECELERATIONS_MPS2[2]))


def safe_speed(
    gap: FloatArray, leader: FloatArray, *, delay_s: float, braking: float = 4.0, keep_m: float = 2.0
) -> FloatArray:
    """(N,) highest speed from which a stop behind a leader that brakes as hard is still possible, m/s.

    Source: Krauss 1998, as Gipps 1981; with equal braking of both.

    Args:
        gap: (N,) m, infinite without a leader.
        leader: (N,) its speed, m/s; ignored without one.
        delay_s: Delay of the command.
        braking: Of both, m/s^2.
        keep_m: Gap that must be left when both stand.
    """
    there = np.isfinite(gap)
    room = np.maximum(np.where(there, gap, 0.0) - keep_m, 0.0)
    ahead = np.where(there, np.maximum(leader, 0.0), 0.0)
    # The gap can be shorter than the leader's own stopping distance; the root is bounded by 0.
    square = (braking * delay_s) ** 2 + ahead**2 + 2 * braking * room
    return np.where(there, np.maximum(np.sqrt(square) - braking * delay_s, 0.0), np.inf)


@dataclass(slots=True)
class LaneChangeRecovery:
    """Detects cut-ins and cut-outs of one vehicle, and adapts the envelopes and the command.

    Attributes:
        grow: Growth of the envelope in 1 s, as a share of the full one.
        least: Least share of the full envelope.
        accelerate: Greatest increase of the command after a cut-out, m/s^2.
        brake: Greatest decrease of the command while recovering from a cut-in, m/s^2.
        urgent_s: Time to collision below which the command is not softened.
    """

    grow: float = 0.15
    least: float = 0.3
    accelerate: float = 1.0
    brake: float = 1.5
    urgent_s: float = 3.0
    _leader: str | None = field(default=None, init=False)
    _ease: float = field(default=1.0, init=False)

    def ease(self, leader: str | None, gap_m: float, envelope_m: float, step_s: float) -> float:
        """Present factor on the envelopes.

        Args:
            leader: Its name, None without one.
            gap_m: To the leader.
            envelope_m: The farthest full envelope.
            step_s: Time since the last call.
        """
        if leader is not None and leader != self._leader and gap_m < envelope_m:
            self._ease = max(self.least, min(self._ease, gap_m / envelope_m))
        else:
            self._ease = min(1.0, self._ease + self.grow * step_s)
        self._leader = leader
        return self._ease

    def softened(self, command: float, own: float, gap_m: float, leader_mps: float, step_s: float) -> float:
        """Command within gentle accelerations; urgent braking is not bounded."""
        upper = own + self.accelerate * step_s
        closing = own - leader_mps
        urgent = closing > 0 and gap_m / closing < self.urgent_s
        lower = 0.0 if urgent or self._ease >= 1.0 else own - self.brake * step_s
        return max(min(command, upper), lower, 0.0)
