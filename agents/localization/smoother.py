"""Smoother: the track that all measurements together give, by a pass backwards over the filter's states.

The filter knows at each moment only the past. The smoother of Rauch, Tung and Striebel (1965) corrects every state by
what came later. States are kept ten times a second, with the transition between them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numba import njit

from dohyo.agents.localization.filters.attitude import exponential, heading_of, inverse, logarithm, normalised, product
from dohyo.agents.localization.filters.base import FilterNoise, InitialState
from dohyo.agents.localization.filters.es_ekf import DT, QUATERNION, EsEkf, transition
from dohyo.agents.localization.filters.measurements import Measurement
from dohyo.sumo_networks.arrays import FloatArray

EVERY_S = 0.1


@dataclass(frozen=True)
class Keyframe:
    """A state that was reached without corrections, and what became of it.

    Attributes:
        time: s.
        predicted: (19,) nominal state before the corrections at this time.
        predicted_covariance: (18, 18).
        corrected: (19,) after them.
        corrected_covariance: (18, 18).
        transition: (18, 18) from the corrected error state before to the predicted one.
    """

    time: float
    predicted: FloatArray
    predicted_covariance: FloatArray
    corrected: FloatArray
    corrected_covariance: FloatArray
    transition: FloatArray


@dataclass(frozen=True)
class SmoothedTrack:
    """States after the backward pass.

    Attributes:
        time: (K,), s.
        position: (K, 3), m.
        velocity: (K, 3), m/s.
        heading: (K,), rad, not wrapped.
        covariance: (K, 3, 3) of the position, m^2.
    """

    time: FloatArray
    position: FloatArray
    velocity: FloatArray
    heading: FloatArray
    covariance: FloatArray


class RecordedEsEkf(EsEkf):
    """An ES-EKF that keeps what the smoother needs."""

    def __init__(self, start: InitialState, noise: FilterNoise, time: float) -> None:
        super().__init__(start, noise)
        self._frames: list[Keyframe] = []
        self._time, self._since = time, 0.0
        self._transition = np.eye(18)
        self._predicted: tuple[FloatArray, FloatArray] = self.nominal.copy(), self.covariance.copy()

    def predict(self, specific_force: FloatArray, rate: FloatArray, dt: float) -> None:
        """See `Filter`."""
        if self._since == 0.0 or self._since >= EVERY_S - 1e-9:
            self._close()
        self._transition = transition(self.nominal, specific_force, rate, dt) @ self._transition
        super().predict(specific_force, rate, dt)
        self._time, self._since = self._time + dt, self._since + dt
        self._predicted = self.nominal.copy(), self.covariance.copy()

    def correct(self, measurement: Measurement) -> None:
        """See `Filter`."""
        super().correct(measurement)
        self._since = 0.0

    def loosen(self, position_std: float, velocity_std: float, heading_std: float) -> None:
        """See `Filter`."""
        self._close()
        super().loosen(position_std, velocity_std, heading_std)
        self._reopen()

    def scale(self, factor: float) -> None:
        """See `Filter`."""
        self._close()
        super().scale(factor)
        self._reopen()

    def __copy__(self) -> Self:
        """See `EsEkf`."""
        out = super().__copy__()
        out._frames = list(self._frames)
        return out

    def smoothed(self) -> SmoothedTrack:
        """Track of the whole journey so far."""
        self._close()
        frames = self._frames
        state, covariance = frames[-1].corrected.copy(), frames[-1].corrected_covariance
        states, covariances = [state], [covariance]
        for before, after in zip(frames[-2::-1], frames[:0:-1], strict=True):
            state, covariance = _step_back(before, after, state, covariance)
            states.append(state)
            covariances.append(covariance)
        table = np.array(states[::-1])
        return SmoothedTrack(
            time=np.array([frame.time for frame in frames]),
            position=table[:, :3],
            velocity=table[:, 3:6],
            heading=np.unwrap([heading_of(one[QUATERNION]) for one in table]),
            covariance=np.array([one[:3, :3] for one in covariances[::-1]]),
        )

    def _close(self) -> None:
        """Ends a keyframe: what has been corrected since it was predicted belongs to it."""
        self._frames.append(
            Keyframe(self._time, *self._predicted, self.nominal.copy(), self.covariance.copy(), self._transition)
        )
        self._reopen()

    def _reopen(self) -> None:
        self._transition, self._since = np.eye(18), 0.0
        self._predicted = self.nominal.copy(), self.covariance.copy()


def _step_back(
    before: Keyframe, after: Keyframe, state: FloatArray, covariance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Smoothed state and covariance at a keyframe, by those of the next one."""
    gain = np.linalg.solve(after.predicted_covariance, after.transition @ before.corrected_covariance).T
    smoothed = put_in(before.corrected, gain @ difference(state, after.predicted))
    out = before.corrected_covariance + gain @ (covariance - after.predicted_covariance) @ gain.T
    return smoothed, 0.5 * (out + out.T)


@njit(cache=True)
def difference(state: FloatArray, nominal: FloatArray) -> FloatArray:
    """(18,) error state that takes a (19,) nominal state to another one."""
    out = np.empty(18)
    out[:6] = state[:6] - nominal[:6]
    out[DT] = logarithm(product(inverse(nominal[QUATERNION]), state[QUATERNION]))
    out[9:] = state[10:] - nominal[10:]
    return out


@njit(cache=True)
def put_in(nominal: FloatArray, error: FloatArray) -> FloatArray:
    """(19,) nominal state with an (18,) error put in."""
    out = np.empty(19)
    out[:6] = nominal[:6] + error[:6]
    out[QUATERNION] = normalised(product(nominal[QUATERNION], exponential(error[DT])))
    out[10:] = nominal[10:] + error[9:]
    return out
