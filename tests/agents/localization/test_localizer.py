"""The localizer: calibration, alignment, outages, outliers; and that it knows nothing but its two sensors."""

from __future__ import annotations

import dataclasses
import inspect
import math
from functools import cache

import numpy as np
import pytest
from pydantic import ValidationError

from dohyo.agents.localization.filters.base import FilterNoise
from dohyo.agents.localization.filters.es_ekf import EsEkf
from dohyo.agents.localization.filters.measurements import Measurement, PointVelocity
from dohyo.agents.localization.localizer import FILTERS, Fix, Localizer
from dohyo.agents.localization.settings import CarConstraint, Settings
from dohyo.agents.localization.starts.calibration import calibrate
from dohyo.agents.localization.study.grid import fixes_of, score
from dohyo.agents.localization.study.synthetic import DT, Journey, Recording, journey_named, record
from dohyo.agents.localization.track import EstimatedTrack, follow
from dohyo.evaluation.scores.localization import errors
from dohyo.sumo_networks.ego.dynamics import GRAVITY
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.sensors.gnss import GnssNoise
from dohyo.sumo_networks.sensors.imu import ICM_20600, ImuErrors

WHITE = GnssNoise(0.3, correlated_share=0.0)


@cache
def roundabout() -> Journey:
    return journey_named("roundabout", seconds=60.0)


def recorded(seed: int = 0, gnss: GnssNoise = WHITE, open_sky_s: float = 20.0) -> Recording:
    return record(roundabout(), ICM_20600, gnss, np.random.default_rng(seed), open_sky_s)


def settings(**changes: object) -> Settings:
    known = {"gnss_sigma_m": 0.3, "noise": FilterNoise.of(ICM_20600), "car": CarConstraint(level_rad=None)}
    return Settings(**(known | changes))


def led(recording: Recording, fixes: list[Fix] | None = None, **changes: object) -> EstimatedTrack:
    journey = roundabout()
    own = fixes_of(journey, recording) if fixes is None else fixes
    return follow(Localizer(settings(**changes)), journey.time, recording.imu, own)


def off(track: EstimatedTrack) -> np.ndarray:
    return errors(track.position, roundabout().position[track.row.astype(int)])


# The synthetic truth


def test_the_truth_is_smooth_and_a_calm_drive_through_the_circle() -> None:
    journey = roundabout()
    speed = np.hypot(*journey.velocity.T)
    np.testing.assert_allclose(np.diff(journey.position, axis=0), journey.velocity[1:] * DT, atol=2e-3)
    assert np.abs(np.diff(journey.heading)).max() < 0.01
    assert np.abs(journey.imu[:, 1]).max() < 4.0
    assert speed.max() < 14.5
    assert np.ptp(journey.heading) > math.pi
    assert not journey.moving[:490].any()
    assert (journey.imu[:, 2] == GRAVITY).all()


def test_all_rates_see_the_same_errors() -> None:
    often, rarely = recorded(1), recorded(1, dataclasses.replace(WHITE, rate_hz=0.2))
    np.testing.assert_array_equal(often.imu, rarely.imu)
    shared = np.isin(often.fix_rows, rarely.fix_rows)
    np.testing.assert_array_equal(often.fixes[shared], rarely.fixes)
    late = rarely.fix_rows[rarely.fix_rows * DT > 20.0]
    np.testing.assert_allclose(np.diff(late) * DT, 5.0)


# Calibration


def test_calibration_finds_the_offsets_of_the_thesis() -> None:
    true = np.tile([0.0, 0.0, GRAVITY, 0.0, 0.0, 0.0], (500, 1))
    instrument = ImuErrors(ICM_20600, np.random.default_rng(0))
    offset = instrument.offset.copy()
    found = calibrate(instrument.corrupt(true, moving=False))
    assert np.abs(offset[:3]).max() > 0.1
    np.testing.assert_allclose(found.offset[:3], offset[:3], atol=2e-3)
    np.testing.assert_allclose(found.offset[3:], offset[3:], atol=2e-4)
    np.testing.assert_allclose(found.std[:3], 9.81e-3 / math.sqrt(500), rtol=0.15)
    np.testing.assert_allclose(found.apply(true + offset)[:, :], true, atol=2e-3)


def test_a_vehicle_that_moves_cannot_be_calibrated() -> None:
    moving = roundabout().imu[2500:2800]
    with pytest.raises(InvalidInputError, match="expected the vehicle to stand still"):
        calibrate(moving)
    turning_slowly = np.tile([0.0, 0.0, GRAVITY, 0.0, 0.0, 0.0], (300, 1))
    turning_slowly[:, 5] = np.linspace(0.0, 0.1, 300)
    with pytest.raises(InvalidInputError, match="stand still"):
        calibrate(turning_slowly)
    with pytest.raises(InvalidInputError, match="at least 20"):
        calibrate(moving[:5])


def test_without_calibration_it_is_far_worse() -> None:
    recording = recorded()
    calibrated, raw = off(led(recording, alpha=0.0)), off(led(recording, alpha=0.0, calibrate=False, outliers="none"))
    assert np.mean(calibrated <= 0.5) > 0.95
    assert np.mean(raw <= 0.5) < 0.2
    assert np.sqrt(np.mean(raw**2)) > 10.0 * np.sqrt(np.mean(calibrated**2))


# Alignment


@pytest.mark.parametrize("seed", range(3))
def test_the_heading_comes_from_the_course(seed: int) -> None:
    track = led(recorded(seed))
    true = roundabout().heading[track.row.astype(int)]
    error = np.abs([math.remainder(a - b, 2 * math.pi) for a, b in zip(track.heading, true, strict=True)])
    assert error[0] < 0.15
    assert error[1000:].max() < 0.03
    assert 7.0 < track.time[0] < 10.0, "soon after setting off at 5 s"


def test_with_a_heading_from_the_map_it_runs_as_soon_as_it_is_calibrated() -> None:
    journey, recording = roundabout(), recorded()
    localizer = Localizer(settings(), heading=(float(journey.heading[0]), 0.05))
    track = follow(localizer, journey.time, recording.imu, fixes_of(journey, recording))
    assert track.time[0] == pytest.approx(3.01, abs=0.02)
    assert off(track).max() < 1.0


def test_who_never_sets_off_is_told_so() -> None:
    journey, recording = roundabout(), recorded()
    with pytest.raises(InvalidInputError, match=r"expected the vehicle to move .* from its start"):
        follow(Localizer(settings()), journey.time[:450], recording.imu[:450], fixes_of(journey, recording)[:45])


# Outages and outliers


@pytest.mark.parametrize("name", ["es-ekf", "ekf", "ukf"])
def test_ten_fixes_a_second_keep_it_within_half_a_metre(name: str) -> None:
    track = led(recorded(), filter=name)
    assert np.mean(off(track) <= 0.5) > 0.95
    result = score(track, roundabout())
    assert result["accuracy"] > 95.0
    assert 0.3 < result["nees"] < 6.0


def test_accuracy_falls_gracefully_with_the_rate() -> None:
    accuracies = [
        np.mean(
            [np.mean(off(led(recorded(seed, dataclasses.replace(WHITE, rate_hz=rate)))) <= 0.5) for seed in range(3)]
        )
        for rate in (10.0, 1.0, 0.2, 0.05)
    ]
    assert accuracies == sorted(accuracies, reverse=True)
    assert accuracies[0] > 0.95
    assert accuracies[2] > 0.4


def test_twenty_seconds_without_fixes_cost_metres_and_not_tens_of_them() -> None:
    drifts = []
    for seed in range(5):
        recording = recorded(seed)
        fixes = [fix for fix in fixes_of(roundabout(), recording) if not 30.0 < fix.time < 50.0]
        track = led(recording, fixes)
        error = off(track)
        drifts.append(error[(track.time > 30.0) & (track.time < 50.0)].max())
        assert error[track.time > 52.0].max() < 2.0, "and the next fixes repair it"
    assert max(drifts) < 10.0
    assert min(drifts) > 0.3, "too good to be true: is there a leak?"


def test_dead_reckoning_is_worse_than_any_filter() -> None:
    recording = recorded()
    assert off(led(recording, filter="imu"))[-1] > 3.0 * off(led(recording))[-1]


def test_a_jump_of_100_m_is_left_out() -> None:
    recording = recorded()
    fixes = fixes_of(roundabout(), recording)
    spoilt = [
        Fix(fix.time, fix.position + np.array([100.0, 0.0, 0.0])) if 30.0 < fix.time < 30.25 else fix for fix in fixes
    ]
    track, undisturbed = led(recording, spoilt), led(recording)
    assert track.rejected - undisturbed.rejected == 2
    assert off(track).max() < 1.0
    assert off(led(recording, spoilt, outliers="none")).max() > 10.0


def test_a_receiver_that_stays_elsewhere_is_believed_in_the_end() -> None:
    recording = recorded()
    moved = [
        Fix(fix.time, fix.position + np.array([0.0, 100.0, 0.0])) if fix.time > 40.0 else fix
        for fix in fixes_of(roundabout(), recording)
    ]
    track = led(recording, moved)
    assert track.rejected < 60
    assert off(track)[(track.time > 40.0) & (track.time < 41.9)].max() < 1.0, "not at once"
    end = track.position[-1] - roundabout().position[-1]
    np.testing.assert_allclose(end, [0.0, 100.0], atol=3.0)


def test_gaps_repeated_times_and_missing_fixes_do_no_harm() -> None:
    journey, recording = roundabout(), recorded()
    keep = np.ones(len(journey.time), dtype=bool)
    keep[3000:3040] = False  # 0.4 s of silence, in the circle
    localizer = Localizer(settings())
    fixes = fixes_of(journey, recording)
    fixes[100] = Fix(fixes[100].time, np.full(3, np.nan))
    times, samples = np.repeat(journey.time[keep], 2), np.repeat(recording.imu[keep], 2, axis=0)
    track = follow(localizer, times, samples, fixes)
    plain = led(recording)
    error = np.hypot(*(track.position[-1] - journey.position[-1]))
    assert np.isfinite(track.position).all()
    assert error < 0.5
    assert abs(error - off(plain)[-1]) < 0.2


def at_rest_then_blind(step_s: float, gap_s: float = 0.0) -> Localizer:
    """Localizer of a car that stands for 30 s; the last fix is at 10 s, and a gap in the IMU's samples after it."""
    localizer = Localizer(settings(outliers="none", standing_s=5.0), heading=(0.0, 0.05))
    rng = np.random.default_rng(0)
    for row in range(round(30.0 / step_s)):
        now = row * step_s
        if not 15.0 < now < 15.0 + gap_s:
            localizer.imu(now, np.array([0.0, 0.0, GRAVITY, 0.0, 0.0, 0.0]) + rng.normal(0.0, 1e-4, 6))
        if now <= 10.0 and row % round(1.0 / step_s) == 0:
            localizer.gnss(now, np.zeros(3))
    return localizer


def spread(localizer: Localizer) -> float:
    assert localizer.filter is not None
    return math.sqrt(np.trace(localizer.filter.position_covariance))


@pytest.mark.parametrize("step_s", [0.1, 0.2])
def test_the_samples_of_a_slow_imu_are_no_gaps(step_s: float) -> None:
    assert spread(at_rest_then_blind(step_s)) == pytest.approx(spread(at_rest_then_blind(0.01)), rel=0.1)


@pytest.mark.parametrize("step_s", [0.01, 0.2])
def test_a_gap_raises_the_uncertainty_at_every_rate(step_s: float) -> None:
    assert spread(at_rest_then_blind(step_s, gap_s=0.8)) > 2.0 * spread(at_rest_then_blind(step_s))


@pytest.mark.parametrize("first_fix_s", [0.0, 6.0])
def test_what_cars_do_counts_at_its_intervals_from_the_start_on(
    first_fix_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    used, correct = [], EsEkf.correct

    def counted(filter_: EsEkf, measurement: Measurement) -> None:
        used.append(isinstance(measurement, PointVelocity))
        correct(filter_, measurement)

    monkeypatch.setattr(EsEkf, "correct", counted)
    localizer = Localizer(settings(outliers="none", car=CarConstraint(sideways_mps=0.1, level_rad=None)))
    now = 0.0
    while localizer.filter is None:
        now += 0.01
        sets_off_s = max(now - 5.0, 0.0)
        localizer.imu(now, np.array([0.5 * (sets_off_s > 0.0), 0.0, GRAVITY, 0.0, 0.0, 0.0]))
        if now >= first_fix_s and round(100 * now) % 100 == 0:
            localizer.gnss(now, np.array([0.25 * sets_off_s**2, 0.0, 0.0]))
    assert sum(used) == pytest.approx((now - 3.0) / 0.2, abs=1.0)


# No leaks


def test_a_localizer_is_given_two_sensors_and_nothing_else() -> None:
    assert list(inspect.signature(Localizer.imu).parameters) == ["self", "time", "sample"]
    assert list(inspect.signature(Localizer.gnss).parameters) == ["self", "time", "position", "sigma_m"]


def test_where_the_journey_lies_changes_only_where_the_estimate_lies() -> None:
    """Two recordings with the same samples, their fixes 1 km apart: so are the estimates."""
    recording = recorded()
    moved = [Fix(fix.time, fix.position + np.array([1000.0, -500.0, 0.0])) for fix in fixes_of(roundabout(), recording)]
    np.testing.assert_allclose(
        led(recording, moved).position - led(recording).position,
        [[1000.0, -500.0]] * len(off(led(recording))),
        atol=1e-4,
    )


# Errors


def test_impossible_settings_are_refused() -> None:
    with pytest.raises(ValidationError, match="es-ekf"):
        Settings(filter="es-ekv")
    with pytest.raises(ValidationError, match="greater than 0"):
        Settings(gnss_sigma_m=0.0)
    with pytest.raises(InvalidInputError, match="expected the filter es-ekf, got ekf"):
        Localizer(Settings(filter="ekf", smooth=True))
    with pytest.raises(UnknownNameError, match="route"):
        journey_named("nowhere")
    assert set(FILTERS) == {"es-ekf", "ekf", "ukf", "imu"}
