"""Logs as cars write them: rolling starts, vibration, outages, wild fixes; the smoother, and the warnings."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from dohyo.agents.localization.diagnosis import check_noise, diagnose, measured_noise
from dohyo.agents.localization.filters.base import InitialState
from dohyo.agents.localization.filters.es_ekf import EsEkf, motion_of
from dohyo.agents.localization.filters.measurements import AntennaPosition, LevelRoad, Measurement, PointVelocity
from dohyo.agents.localization.localizer import FilterDivergedError, Fix, Localizer
from dohyo.agents.localization.logs import read_positions, read_wheel_speeds
from dohyo.agents.localization.settings import Settings
from dohyo.agents.localization.smoother import put_in
from dohyo.agents.localization.study.grid import score
from dohyo.agents.localization.study.robustness import BEGIN_S, Case, fixes_of, settings_of
from dohyo.agents.localization.study.synthetic import Journey, journey_named, record
from dohyo.agents.localization.track import EstimatedTrack, follow, smooth
from dohyo.service.cli import app
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.sensors.gnss import GnssNoise
from dohyo.sumo_networks.sensors.imu import ICM_20600
from tests.agents.localization.filters.test_es_ekf import some_state


@cache
def rolling() -> Journey:
    whole = journey_named("roundabout", seconds=65.0)
    first = int(np.searchsorted(whole.time, BEGIN_S))
    arrays = ("time", "position", "velocity", "heading", "imu", "moving")
    return replace(whole, **{name: getattr(whole, name)[first:] for name in arrays})


@cache
def driven(arm: str, outage_s: float = 5.0, gnss_sigma_m: float = 0.5) -> tuple[Localizer, EstimatedTrack, FloatArray]:
    """A journey of the study, with the IMU's samples."""
    case = Case(arm, outage_s, 0.5, "roundabout", 3)
    imu = replace(ICM_20600, vibration=0.5)
    recording = record(rolling(), imu, GnssNoise(0.5, 0.0, rate_hz=1.0), np.random.default_rng(case.seed))
    fixes = fixes_of(case, rolling(), recording.fix_rows, recording.fixes, np.random.default_rng([3, 1]))
    localizer = Localizer(settings_of(case).model_copy(update={"gnss_sigma_m": gnss_sigma_m}))
    return localizer, follow(localizer, rolling().time, recording.imu, fixes), recording.imu


# Rolling starts, outages and wild fixes


def test_wild_fixes_and_outages_cost_a_rolling_start_almost_nothing() -> None:
    known, robust = (score(driven(arm)[1], rolling()) for arm in ("reference", "robust"))
    plain = score(driven("none")[1], rolling())
    assert driven("robust")[1].rejected >= 2
    assert robust["rmse"] < 1.5 * known["rmse"]
    assert robust["rmse"] < 2.0
    assert plain["rmse"] > 5.0 * known["rmse"]
    assert 0.5 < robust["nees"] < 4.0


@pytest.mark.filterwarnings("ignore:overflow encountered")
def test_a_filter_that_diverges_says_when_and_with_which_policy() -> None:
    case, samples = Case("none", 0.0, 0.5, "roundabout", 3), driven("none")[2]
    time, last = rolling().time, float(rolling().time[-1])
    fixes = [Fix(now, np.array([8.0 * now + 1e200 * (now > last - 20.0), 0.0, 0.0])) for now in time[::100].tolist()]
    with pytest.raises(FilterDivergedError, match=r"at \S+ s the filter es-ekf with the outlier policy none diverged"):
        follow(Localizer(settings_of(case)), time, samples, fixes)


def test_a_start_that_looks_at_rest_by_the_imu_alone_is_judged_by_the_fixes() -> None:
    """The drive at constant speed: its samples are those of a parked car, its fixes are not."""
    time = np.arange(0.0, 20.0, 0.01)
    parked = np.tile([0.0, 0.0, 9.81, 0.0, 0.0, 0.0], (len(time), 1))
    localizer = Localizer(Settings(gnss_sigma_m=0.5))
    rng = np.random.default_rng(0)
    for row, now in enumerate(time.tolist()):
        localizer.imu(now, parked[row] + 0.02 * rng.standard_normal(6) * [1, 1, 1, 0.01, 0.01, 0.01])
        if row % 100 == 0:
            localizer.gnss(now, np.array([8.0 * now, 6.0 * now, 0.0]) + 0.5 * rng.standard_normal(3))
    assert localizer.rolling
    assert localizer.filter is not None
    np.testing.assert_allclose(localizer.filter.velocity[:2], [8.0, 6.0], atol=0.7)
    assert localizer.filter.heading == pytest.approx(np.arctan2(6.0, 8.0), abs=0.1)


# The smoother


def test_the_smoother_knows_what_came_after_an_outage() -> None:
    localizer, track, samples = driven("reference")
    case = Case("reference", 5.0, 0.5, "roundabout", 3)
    recording = record(
        rolling(), replace(ICM_20600, vibration=0.5), GnssNoise(0.5, 0.0, rate_hz=1.0), np.random.default_rng(3)
    )
    fixes = fixes_of(case, rolling(), recording.fix_rows, recording.fixes, np.random.default_rng([3, 1]))
    late = smooth(localizer, track, rolling().time, samples, fixes)
    assert late.time[0] < track.time[0], "back to the first fix"
    assert score(late, rolling())["rmse"] < 0.7 * score(track, rolling())["rmse"]
    assert 0.3 < score(late, rolling())["nees"] < 6.0


# Warnings


def test_wrong_settings_are_warned_of_and_right_ones_are_not() -> None:
    _, right, samples = driven("robust")
    settings = Settings(gnss_sigma_m=0.5)
    assert diagnose(right, settings) == []
    assert [one.code for one in diagnose(driven("robust", gnss_sigma_m=0.1)[1], settings)][:1] == ["too-sure"]
    assert [one.code for one in diagnose(driven("robust", gnss_sigma_m=5.0)[1], settings)] == ["too-unsure"]
    accelerometer, _ = measured_noise(rolling().time, samples)
    assert accelerometer == pytest.approx(0.05, rel=0.2)
    assert check_noise(rolling().time, samples, settings) == []
    quiet = settings.model_copy(update={"noise": settings.noise.model_copy(update={"accelerometer": 1e-3})})
    assert [one.code for one in check_noise(rolling().time, samples, quiet)] == ["accelerometer-noise"]


# Measurements


@pytest.mark.parametrize(
    "measurement",
    [
        AntennaPosition.of(np.zeros(3), 1.0, (0.5, -0.3, 1.2)),
        PointVelocity.of([1.0, 0.0, 0.0], [0.1] * 3, [0, 1, 2], (-1.4, 0.1, -0.3)),
        LevelRoad.of(0.05),
    ],
)
def test_the_jacobian_of_a_measurement_is_its_derivative(measurement: Measurement) -> None:
    state, rate = some_state(4), np.array([0.1, -0.2, 0.6])
    columns = []
    for i in range(18):
        step = 1e-6 * np.eye(18)[i]
        plus, minus = (measurement.expected(motion_of(put_in(state, sign * step), rate)) for sign in (1.0, -1.0))
        columns.append((plus - minus) / 2e-6)
    np.testing.assert_allclose(measurement.jacobian(motion_of(state, rate)), np.array(columns).T, atol=1e-6)


def test_a_lever_moves_the_estimate_to_the_imu() -> None:
    start = InitialState(np.zeros(3), np.zeros(3), np.pi / 2, 10.0, 0.1, 0.01)
    filter_ = EsEkf(start, Settings().noise)
    filter_.correct(AntennaPosition.of(np.array([5.0, 2.0, 1.0]), 0.01, (2.0, 0.0, 1.0)))
    np.testing.assert_allclose(filter_.position, [5.0, 0.0, 0.0], atol=0.03)


# From outside


def test_the_command_takes_settings_writes_a_track_and_is_strict(tmp_path: Path) -> None:
    _, _, samples = driven("robust")
    imu = np.column_stack([rolling().time, samples])
    rows = np.arange(99, len(imu), 100)
    noise = 0.5 * np.random.default_rng(5).standard_normal((len(rows), 2))
    gnss = np.column_stack([rolling().time[rows], rolling().position[rows] + noise, np.full(len(rows), 0.5)])
    for name, head, table in (("imu", "t,ax,ay,az,gx,gy,gz", imu), ("gnss", "t,x,y,sigma", gnss)):
        np.savetxt(tmp_path / f"{name}.csv", table, delimiter=",", header=head, comments="", fmt="%.9g")
    (tmp_path / "car.toml").write_text('start = "rolling"\n[car]\nsideways_mps = 0.2\naxle_m = [-1.4, 0.0, 0.0]\n')
    words = ["localize", "--imu", tmp_path / "imu.csv", "--gnss", tmp_path / "gnss.csv", "--strict", "--json"]
    words += ["--config", tmp_path / "car.toml", "--track", tmp_path / "track.csv", "--no-smooth"]
    good = CliRunner().invoke(app, [str(word) for word in words])
    assert good.exit_code == 0, good.output
    track = np.genfromtxt(tmp_path / "track.csv", delimiter=",", names=True)
    true = rolling().position[np.searchsorted(rolling().time, track["t"] - 1e-6)]
    assert np.median(np.hypot(track["x"] - true[:, 0], track["y"] - true[:, 1])) < 0.6
    bad = CliRunner().invoke(app, [*map(str, words), "--set", "noise.accelerometer=0.001"])
    assert bad.exit_code == 3
    assert "accelerometer-noise" in [one["code"] for one in json.loads(bad.stdout)["warnings"]]


def test_sigma_and_wheel_speeds_are_read_and_checked(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t,x,y,sigma\n0,1,2,0.5\n1,2,3,4\n")
    assert [fix.sigma_m for fix in read_positions(path).fixes()] == [0.5, 4.0]
    path.write_text("t,x,y,sigma\n0,1,2,0.5\n1,2,3,0\n")
    with pytest.raises(InvalidInputError, match="sigma above 0 m"):
        read_positions(path)
    path.write_text("t,v\n0,100\n1,101\n")
    with pytest.raises(InvalidInputError, match="is v in km/h"):
        read_wheel_speeds(path)
