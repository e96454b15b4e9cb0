"""EKF and UKF: the same model as the ES-EKF, so that only the filters differ."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dohyo.agents.localization.filters.attitude import exponential, matrix, normalised, product
from dohyo.agents.localization.filters.base import Filter, FilterNoise, InitialState
from dohyo.agents.localization.filters.ekf import Ekf, _linearised
from dohyo.agents.localization.filters.es_ekf import EsEkf, integrate
from dohyo.agents.localization.filters.lowpass import LowPass, cut_off_hz, delay_s
from dohyo.agents.localization.filters.measurements import AntennaPosition
from dohyo.agents.localization.filters.ukf import Ukf, _moved
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.errors import InvalidInputError
from tests.agents.localization.filters.test_es_ekf import some_state, start

FORCE, RATE = np.array([1.0, 3.0, 9.8]), np.array([0.1, -0.2, 0.6])


def unnormalised_motion(state: FloatArray, dt: float) -> FloatArray:
    """The motion with the quaternion as four free numbers, as the EKF linearises it."""
    out, q = state.copy(), state[6:10]
    w, v, force = q[0], q[1:4], FORCE - state[10:13]
    turned = (w * w - v @ v) * force + 2 * v * (v @ force) + 2 * w * np.cross(v, force)
    out[:3] += dt * state[3:6]
    out[3:6] += dt * (turned + state[16:])
    out[6:10] = product(q, exponential((RATE - state[13:16]) * dt))
    return out


def test_the_ekfs_jacobian_is_the_motions() -> None:
    state, dt = some_state(1), 1e-3
    F, _ = _linearised(state, FORCE, RATE, dt, np.ones(4))
    columns = []
    for i in range(19):
        step = 1e-6 * np.eye(19)[i]
        columns.append((unnormalised_motion(state + step, dt) - unnormalised_motion(state - step, dt)) / 2e-6)
    np.testing.assert_allclose(F, np.array(columns).T, atol=1e-6)


def test_the_ukfs_points_move_as_the_nominal_state() -> None:
    roll, pitch, yaw = 0.1, -0.2, 3.0
    q = product(
        product(exponential(np.array([0, 0, yaw])), exponential(np.array([0, pitch, 0.0]))),
        exponential(np.array([roll, 0.0, 0.0])),
    )
    state = some_state(2)
    state[6:10] = normalised(q)
    point = np.concatenate([state[:6], [roll, pitch, yaw], state[10:]])
    (moved,) = _moved(point[None], FORCE, np.array([0.0, 0.0, 20.0]), 0.01)
    integrate(state, FORCE, np.array([0.0, 0.0, 20.0]), 0.01)
    np.testing.assert_allclose(moved[:6], state[:6], atol=1e-12)
    assert moved[8] > math.pi, "yaw goes on past pi"
    R = matrix(state[6:10])
    assert math.cos(moved[8] - math.atan2(R[1, 0], R[0, 0])) == pytest.approx(1.0)
    assert math.sin(moved[7]) == pytest.approx(-R[2, 0])


def drive(filter_: Filter, seconds: int = 20) -> None:
    rng, true = np.random.default_rng(0), np.zeros(19)
    true[3], true[6], true[18] = 8.0, 1.0, -9.81
    for step in range(1, 100 * seconds + 1):
        turning = 0.3 * math.sin(0.01 * step)
        force, rate = np.array([0.3, 8.0 * turning, 9.81]), np.array([0.0, 0.0, turning])
        integrate(true, force, rate, 0.01)
        filter_.predict(force + 0.01 * rng.standard_normal(3), rate + 1e-3 * rng.standard_normal(3), 0.01)
        if step % 10 == 0:
            filter_.correct(AntennaPosition.of(true[:3] + 0.3 * rng.standard_normal(3), 0.3))


@pytest.mark.parametrize("baseline", [Ekf, Ukf])
def test_in_an_easy_case_they_agree_with_the_es_ekf(baseline: type[Filter]) -> None:
    known = start(heading=0.0, heading_std=0.02)
    ours, theirs = EsEkf(known, FilterNoise()), baseline(known, FilterNoise())
    drive(ours)
    drive(theirs)
    np.testing.assert_allclose(theirs.position, ours.position, atol=0.03)
    np.testing.assert_allclose(theirs.velocity, ours.velocity, atol=0.03)
    assert theirs.heading == pytest.approx(ours.heading, abs=5e-3)
    np.testing.assert_allclose(theirs.position_covariance, ours.position_covariance, atol=2e-3)


@pytest.mark.parametrize("kind", [EsEkf, Ekf, Ukf])
def test_forgetting_widens_and_a_fix_then_moves_further(kind: type[Filter]) -> None:
    def after_fix(loosened: bool) -> FloatArray:
        filter_ = kind(InitialState(np.zeros(3), np.zeros(3), 0.0, 0.1, 0.1, 0.1), FilterNoise())
        filter_.predict(np.array([0.0, 0.0, 9.81]), np.zeros(3), 0.01)
        if loosened:
            filter_.loosen(5.0, 1.0, 0.2)
        expected = filter_.expect(AntennaPosition.of(np.array([4.0, 0.0, 0.0]), 0.5))
        assert expected.nis == pytest.approx(16.0 / (0.26 + 25.0 * loosened), rel=0.05)
        filter_.correct(AntennaPosition.of(np.array([4.0, 0.0, 0.0]), 0.5))
        return filter_.position

    assert after_fix(False)[0] < 0.2
    assert after_fix(True)[0] > 3.8


# Low-pass


def test_the_low_pass_delays_a_slow_signal_by_as_much_as_theory_says() -> None:
    alpha, dt = 0.6, 0.01
    filter_ = LowPass(alpha)
    out = np.array([filter_.step(np.array([0.5 * n * dt]))[0] for n in range(500)])
    late = (0.5 * 499 * dt - out[-1]) / 0.5  # on a ramp, the lag is the delay
    assert late == pytest.approx(delay_s(alpha, dt), rel=1e-6)
    assert delay_s(alpha, dt) == pytest.approx(0.015)


@pytest.mark.parametrize(("alpha", "hertz"), [(0.6, 10.6), (0.7, 6.8), (0.8, 4.0)])
def test_the_cut_off_is_the_thesiss(alpha: float, hertz: float) -> None:
    assert cut_off_hz(alpha, 0.01) == pytest.approx(hertz, abs=0.05)


def test_the_low_pass_keeps_a_constant_and_takes_noise_away() -> None:
    filter_, rng = LowPass(0.6), np.random.default_rng(0)
    out = np.array([filter_.step(3.0 + rng.standard_normal(6)) for _ in range(20_000)])
    assert out.mean() == pytest.approx(3.0, abs=0.02)
    assert out[100:].var() == pytest.approx((1 - 0.6) / (1 + 0.6), rel=0.05)
    assert cut_off_hz(0.0, 0.01) == math.inf
    with pytest.raises(InvalidInputError, match="alpha"):
        LowPass(1.0)
