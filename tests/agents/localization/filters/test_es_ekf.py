"""ES-EKF: its Jacobians against numbers, its covariance against the textbook, its consistency against chi-square."""

from __future__ import annotations

import math

import numpy as np
import pytest
from filterpy.stats import mahalanobis

from dohyo.agents.localization.filters.attitude import (
    exponential,
    from_heading,
    inverse,
    logarithm,
    normalised,
    product,
)
from dohyo.agents.localization.filters.base import CONDITIONING, FilterNoise, InitialState
from dohyo.agents.localization.filters.consistency import mean_bounds, nees, quantile
from dohyo.agents.localization.filters.es_ekf import DT, EsEkf, integrate, reset_jacobian, transition
from dohyo.agents.localization.filters.measurements import AntennaPosition, gnss_covariance
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.sensors.imu import ICM_20600

STEP = 0.01


def some_state(seed: int = 0) -> FloatArray:
    rng = np.random.default_rng(seed)
    state = 0.1 * rng.standard_normal(19)
    state[3:6] = 10.0 * rng.standard_normal(3)
    state[6:10] = normalised(np.array([0.8, 0.1, -0.2, 0.5]) + 0.2 * rng.standard_normal(4))
    state[16:] = 0.0, 0.0, -9.81
    return state


def start(**changes: object) -> InitialState:
    defaults: dict[str, object] = {
        "position": np.zeros(3),
        "velocity": np.array([8.0, 0.0, 0.0]),
        "heading": 0.4,
        "position_std": 0.5,
        "velocity_std": 0.3,
        "heading_std": 0.05,
    }
    return InitialState(**(defaults | changes))  # type: ignore[arg-type]


def put_in(state: FloatArray, error: FloatArray) -> FloatArray:
    """A true state: the nominal one with an error put in."""
    out = state.copy()
    out[:6] += error[:6]
    out[6:10] = product(state[6:10], exponential(error[DT]))
    out[10:] += error[9:]
    return out


def apart(true: FloatArray, state: FloatArray) -> FloatArray:
    """The error that takes a nominal state to the true one."""
    turn = logarithm(product(inverse(state[6:10]), true[6:10]))
    return np.concatenate([true[:6] - state[:6], turn, true[10:] - state[10:]])


def numerical_transition(state: FloatArray, force: FloatArray, rate: FloatArray, dt: float) -> FloatArray:
    after = state.copy()
    integrate(after, force, rate, dt)
    columns = []
    for i in range(18):
        error = np.zeros(18)
        error[i] = 1e-5
        plus, minus = put_in(state, error), put_in(state, -error)
        integrate(plus, force, rate, dt)
        integrate(minus, force, rate, dt)
        columns.append((apart(plus, after) - apart(minus, after)) / 2e-5)
    return np.array(columns).T


@pytest.mark.parametrize("seed", range(3))
def test_the_transition_is_the_jacobian_of_the_motion_to_first_order(seed: int) -> None:
    force, rate = np.array([1.0, 3.0, 9.8]), np.array([0.1, -0.2, 0.6])
    wrong = []
    for dt in (0.02, 0.01, 0.005):
        F = transition(some_state(seed), force, rate, dt)
        wrong.append(np.abs(F - numerical_transition(some_state(seed), force, rate, dt)).max())
    assert wrong[1] < 1e-3
    # What is left out is of second order: half the step, a quarter of the error.
    assert wrong[1] / wrong[0] == pytest.approx(0.25, abs=0.05)
    assert wrong[2] / wrong[1] == pytest.approx(0.25, abs=0.05)


def test_a_prediction_moves_the_covariance_as_the_textbook_says() -> None:
    filter_, noise = EsEkf(start(), FilterNoise()), FilterNoise()
    factor = np.random.default_rng(0).standard_normal((18, 18))
    filter_.covariance[:] = 1e-3 * factor @ factor.T
    filter_.nominal[:] = some_state()
    P, force, rate = filter_.covariance.copy(), np.array([1.0, 3.0, 9.8]), np.array([0.1, -0.2, 0.6])
    F = transition(filter_.nominal, force, rate, STEP)
    variances = np.repeat(
        np.array([0, noise.accelerometer, noise.gyroscope, noise.accelerometer_walk, noise.gyroscope_walk, 0]) ** 2, 3
    )
    filter_.predict(force, rate, STEP)
    expected = F @ P @ F.T + np.diag(variances) * STEP + CONDITIONING * np.eye(18)
    np.testing.assert_allclose(filter_.covariance, expected, atol=1e-15)


def corrected() -> tuple[EsEkf, FloatArray, FloatArray, FloatArray]:
    """A filter after a fix; its covariance before; its gain; the error found."""
    filter_ = EsEkf(start(heading_std=1.0), FilterNoise())
    factor = np.random.default_rng(3).standard_normal((18, 18))
    filter_.covariance[:] = 0.05 * factor @ factor.T
    P, fix = filter_.covariance.copy(), np.array([3.0, -2.0, 0.5])
    K = P[:, :3] @ np.linalg.inv(P[:3, :3] + gnss_covariance(0.5))
    filter_.correct(AntennaPosition.of(fix, 0.5))
    return filter_, P, K, K @ fix


def test_a_correction_is_josephs_form_and_then_the_reset() -> None:
    filter_, P, K, error = corrected()
    left = np.eye(18)
    left[:, :3] -= K
    joseph = left @ P @ left.T + K @ gnss_covariance(0.5) @ K.T
    G = np.eye(18)
    G[DT, DT] = reset_jacobian(error[DT])
    np.testing.assert_allclose(filter_.covariance, G @ joseph @ G.T, atol=1e-12)
    assert np.abs(error[DT]).max() > 0.1, "too small a correction to see the reset"
    assert np.abs(filter_.covariance - joseph).max() > 1e-3, "without the reset it would be the same"
    np.testing.assert_allclose(filter_.nominal[:3], error[:3], atol=1e-12)
    assert np.linalg.eigvalsh(filter_.covariance).min() > 0.0


@pytest.mark.parametrize("size", [0.2, 0.6])
def test_the_reset_turns_the_errors_frame(size: float) -> None:
    """Errors around the uncorrected attitude, counted anew from the corrected one: G is their Jacobian, I is not."""
    correction = size * np.array([0.3, -0.4, 0.866])

    def counted_anew(error: FloatArray) -> FloatArray:
        return logarithm(product(exponential(-correction), exponential(error)))

    step = 1e-6
    numerical = np.array(
        [(counted_anew(correction + step * e) - counted_anew(correction - step * e)) / (2 * step) for e in np.eye(3)]
    ).T
    with_reset = np.abs(numerical - reset_jacobian(correction)).max()
    without = np.abs(numerical - np.eye(3)).max()
    assert with_reset < 0.2 * size**2 + 1e-6
    assert without > 0.4 * size * 0.866
    assert with_reset < 0.3 * without


def test_the_covariance_stays_positive_over_a_long_drive() -> None:
    filter_ = EsEkf(start(), FilterNoise.of(ICM_20600))
    for step in range(20_000):
        filter_.predict(np.array([0.1, 1.0, 9.81]), np.array([0.0, 0.0, 0.12]), STEP)
        if step % 10 == 9:
            filter_.correct(AntennaPosition.of(filter_.position, 0.1))
    np.testing.assert_array_equal(filter_.covariance, filter_.covariance.T)
    assert np.linalg.eigvalsh(filter_.covariance).min() > 0.0
    assert np.linalg.norm(filter_.nominal[6:10]) == pytest.approx(1.0)


RUNS, CHECKED_S = 50, (2, 5, 10, 20, 30)


def matched_run(seed: int, believed_sigma: float = 0.5) -> FloatArray:
    """(5, 3) NEES of all 15 states that move, of the position, and the NIS, at the times checked.

    The truth starts as far off as the filter's covariance says, and everything is as noisy as it believes; but for the
    fixes, whose sigma is 0.5 m, where it is told another one.
    """
    rng, noise, sigma = np.random.default_rng(seed), FilterNoise.of(ICM_20600), 0.5
    filter_ = EsEkf(start(), noise)
    true = put_in(filter_.nominal, start().deviations() * rng.standard_normal(18))
    out = []
    for step in range(1, 100 * CHECKED_S[-1] + 1):
        turning = 0.3 * math.sin(0.005 * step)
        force = np.array([0.8 * math.cos(0.003 * step), 8.0 * turning, 9.81])
        rate = np.array([0.0, 0.0, turning])
        integrate(true, force + true[10:13], rate + true[13:16], STEP)
        white = rng.standard_normal(6) / math.sqrt(STEP)
        measured_force = force + true[10:13] + noise.accelerometer * white[:3]
        measured_rate = rate + true[13:16] + noise.gyroscope * white[3:]
        walk = rng.standard_normal(6) * math.sqrt(STEP)
        true[10:13] += noise.accelerometer_walk * walk[:3]
        true[13:16] += noise.gyroscope_walk * walk[3:]
        filter_.predict(measured_force, measured_rate, STEP)
        if step % 10 == 0:
            fix = true[:3] + np.sqrt(np.diag(gnss_covariance(sigma))) * rng.standard_normal(3)
            innovation = filter_.expect(AntennaPosition.of(fix, believed_sigma))
            filter_.correct(AntennaPosition.of(fix, believed_sigma))
        if step % 100 == 0 and step // 100 in CHECKED_S:
            error = apart(true, filter_.nominal)
            np.testing.assert_allclose(filter_.error(true[:3], true[3:6], true[6:10]), error[:9], atol=1e-3)
            full = nees(error[:15], filter_.covariance[:15, :15])
            out.append([full, nees(error[:3], filter_.covariance[:3, :3]), innovation.nis])
    return np.array(out)


def test_nees_and_nis_lie_within_their_95_percent_bounds_over_50_runs_of_matched_noise() -> None:
    means = np.mean([matched_run(seed) for seed in range(RUNS)], axis=0)
    for column, dimension in enumerate((15, 3, 3)):
        low, high = mean_bounds(dimension, RUNS)
        inside = (means[:, column] > low) & (means[:, column] < high)
        # Of five times one may lie outside by chance (1 in 20 each).
        assert inside.sum() >= 4, (dimension, means[:, column], low, high)


@pytest.mark.parametrize(("believed", "side"), [(0.3, 1), (1.0, -1)])
def test_a_filter_that_is_told_the_wrong_noise_falls_out_of_the_bounds(believed: float, side: int) -> None:
    means = np.mean([matched_run(seed, believed) for seed in range(10)], axis=0)
    low, high = mean_bounds(3, 10)
    assert ((means[1:, 2] > high) if side > 0 else (means[1:, 2] < low)).mean() >= 0.75


def test_bounds_and_quantiles_are_chi_squares() -> None:
    draws = np.random.default_rng(0).standard_normal((20_000, 50, 3))
    means = (draws**2).sum(axis=2).mean(axis=1)
    low, high = mean_bounds(3, 50)
    assert np.mean((means > low) & (means < high)) == pytest.approx(0.95, abs=0.01)
    assert quantile(3, 0.95) == pytest.approx(7.815, abs=1e-3)
    error, covariance = np.array([1.0, -2.0]), np.array([[2.0, 0.5], [0.5, 1.0]])
    assert nees(error, covariance) == pytest.approx(mahalanobis(error, np.zeros(2), covariance) ** 2)


def test_heading_and_error_count_as_they_should() -> None:
    filter_ = EsEkf(start(heading=3.0), FilterNoise())
    assert filter_.heading == pytest.approx(3.0)
    error = filter_.error(np.ones(3), np.zeros(3), from_heading(3.01))
    np.testing.assert_allclose(error, [1, 1, 1, -8, 0, 0, 0, 0, 0.01], atol=1e-6)
