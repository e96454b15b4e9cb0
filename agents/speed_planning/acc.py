"""ACC-based controller: a policy sets speed and gap of a car's own cruise control, which drives safely.

97 of the 100 cars of the field test had it. The cruise control takes 20 to 80 mph in steps of 1 mph and three gaps;
below 20 mph a car only follows. Its equations are ours, for those of a real car are not public: a speed and a time-gap
regulator, the lower of the two, and an emergency brake over both.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numba import njit

from dohyo.agents.learning.networks.policy import TanhActor
from dohyo.sumo_networks.arrays import BoolArray, FloatArray, IntArray

MPH = 0.44704
SLOWEST_MPH, FASTEST_MPH = 20, 80
TIME_GAPS_S = (1.2, 1.6, 2.2)
"""Time gaps of the settings 1, 2, 3; ours."""
STANDING_GAP_M = 3.0
ACCELERATES, BRAKES, EMERGENCY = 1.5, -3.0, -8.0
"""Limits of the cruise control, and of the emergency brake, m/s^2."""
EMERGENCY_TTC_S = 1.8
SEEN_M = 80.0
"""Range in which a leader is seen, m."""
DECISION_S = 0.5
OBSERVATIONS, ACTIONS = 34, 2
PAST_ACCELERATIONS, PAST_PAIRS = 5, 10
CHECKPOINT = Path(__file__).with_name("checkpoints") / "acc.safetensors"


@njit(cache=True)
def stock_acc(speed: float, gap: float, leader: float, setting: float, time_gap: float) -> float:
    """Acceleration of the cruise control, m/s^2.

    Args:
        speed: Own, m/s.
        gap: m, infinite without a leader.
        leader: Its speed, m/s.
        setting: Set speed, m/s.
        time_gap: Set time gap, s.
    """
    wanted = 0.4 * (setting - speed)
    if gap < np.inf:
        wanted = min(wanted, 0.12 * (gap - STANDING_GAP_M - time_gap * speed) + 0.7 * (leader - speed))
    wanted = min(max(wanted, BRAKES), ACCELERATES)
    closing = speed - leader
    if gap < np.inf and closing > 0:
        # Braking that removes the difference of speeds before half a metre is left.
        needed = closing * closing / (2 * max(gap - 0.5, 0.01))
        if gap / closing < EMERGENCY_TTC_S or needed > -BRAKES:
            wanted = min(wanted, -needed * 1.3)
    if gap < 1.0:
        wanted = min(wanted, BRAKES)
    return max(wanted, EMERGENCY)


@dataclass(frozen=True, slots=True)
class Settings:
    """Settings chosen by the policy.

    Attributes:
        speed: (N,) m/s, whole mph.
        gap: (N,) 0, 1 or 2: row of `TIME_GAPS_S`.
    """

    speed: FloatArray
    gap: FloatArray


def settings_of(action: FloatArray) -> Settings:
    """(N, 2) in [-1, 1] -> speed int((a + 1) 20) m/s, rounded to the car's mph; gap by thresholds at -1/3 and 1/3."""
    speed = np.floor((np.clip(action[:, 0], -1, 1) + 1) * 20)
    mph = np.clip(np.round(speed / MPH), SLOWEST_MPH, FASTEST_MPH)
    gap = np.digitize(action[:, 1], (-1 / 3, 1 / 3)).astype(np.float64)
    return Settings(mph * MPH, gap)


@dataclass
class Memory:
    """Memory of the policy for N cars, most recent first.

    Attributes:
        accelerations: (N, 5) m/s^2.
        speeds: (N, 10) m/s.
        requests: (N, 10) set speeds, m/s.
        gap: (N,) set gap, 0 to 2.
    """

    accelerations: FloatArray
    speeds: FloatArray
    requests: FloatArray
    gap: FloatArray

    @classmethod
    def of(cls, speed: FloatArray) -> Memory:
        """Memory of cars that begin at these speeds, with them as settings."""
        n = len(speed)
        pairs = np.repeat(speed[:, None], PAST_PAIRS, axis=1)
        return cls(np.zeros((n, PAST_ACCELERATIONS)), pairs, pairs.copy(), np.ones(n))

    def of_rows(self, rows: IntArray | BoolArray) -> Memory:
        """Copy of some cars' memory."""
        return Memory(self.accelerations[rows], self.speeds[rows], self.requests[rows], self.gap[rows])

    def replace(self, rows: IntArray | BoolArray, memory: Memory) -> None:
        """Replaces some cars' memory."""
        self.accelerations[rows], self.speeds[rows] = memory.accelerations, memory.speeds
        self.requests[rows], self.gap[rows] = memory.requests, memory.gap

    def remember(self, acceleration: FloatArray, speed: FloatArray, settings: Settings) -> None:
        """Adds a decision's outcome in front, and drops the oldest."""
        self.accelerations = np.concatenate([acceleration[:, None], self.accelerations[:, :-1]], axis=1)
        self.speeds = np.concatenate([speed[:, None], self.speeds[:, :-1]], axis=1)
        self.requests = np.concatenate([settings.speed[:, None], self.requests[:, :-1]], axis=1)
        self.gap = settings.gap

    def observation(self, speed: FloatArray, gap: FloatArray, plan: FloatArray, open_gap: BoolArray) -> FloatArray:
        """(N, 34) input of the policy.

        Args:
            speed: (N,) m/s.
            gap: (N,) m.
            plan: (N, 4) target speed at 0, 200, 500 and 1000 m, m/s.
            open_gap: (N,) the plan's flag.
        """
        columns = [
            speed[:, None] / 40,
            self.accelerations / 4,
            (gap < SEEN_M)[:, None],
            plan / 40,
            open_gap[:, None],
            self.requests[:, :1] / 40,
            (self.gap[:, None] - 1),
            np.stack([self.speeds, self.requests], axis=2).reshape(len(speed), -1) / 40,
        ]
        return np.concatenate(columns, axis=1).astype(np.float64)


@dataclass(frozen=True, slots=True)
class SetPointPolicy:
    """A trained policy for the set-points.

    Attributes:
        actor: Its network.
    """

    actor: TanhActor

    @classmethod
    def shipped(cls) -> SetPointPolicy:
        """Shipped policy, see `cruise_control_training`.

        Raises:
            InvalidInputError: Its checkpoint is missing.
        """
        return cls(TanhActor.load(CHECKPOINT))

    def settings(self, observation: FloatArray) -> Settings:
        """(N, 34) -> settings."""
        return settings_of(self.actor.act(observation).astype(np.float64))
