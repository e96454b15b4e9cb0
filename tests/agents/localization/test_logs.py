"""Real logs: what is read, what is refused and how; and the command that reads them."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from dohyo.agents.localization.logs import check_together, read_imu, read_positions
from dohyo.agents.localization.study.synthetic import journey_named, record
from dohyo.service.cli import app
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.projection import enu_to_geodetic
from dohyo.sumo_networks.sensors.gnss import GnssNoise
from dohyo.sumo_networks.sensors.imu import ICM_20600

VALLAURIS = (43.58, 7.05, 100.0)
IMU, GNSS = "t,ax,ay,az,gx,gy,gz", "t,lat,lon,alt"


def write(path: Path, header: str, rows: FloatArray) -> Path:
    lines = [",".join(f"{value:.9f}" for value in row) for row in rows]
    path.write_text("\n".join([header, *lines]) + "\n")
    return path


@pytest.fixture(scope="module")
def tables() -> tuple[FloatArray, FloatArray, FloatArray]:
    """IMU, fixes and truth of a minute, the latter two as latitude, longitude and height."""
    journey = journey_named("roundabout", seconds=60.0)
    recording = record(journey, ICM_20600, GnssNoise(0.3, 0.0), np.random.default_rng(0))
    base = np.append(journey.position[0], 0.0)
    rows = recording.fix_rows.astype(int)
    fixes = [enu_to_geodetic(fix - base, VALLAURIS) for fix in recording.fixes]
    true = [enu_to_geodetic(np.append(position, 0.0) - base, VALLAURIS) for position in journey.position[::10]]
    return (
        np.column_stack([journey.time, recording.imu]),
        np.column_stack([journey.time[rows], fixes]),
        np.column_stack([journey.time[::10], true]),
    )


@pytest.fixture
def logs(tmp_path: Path, tables: tuple[FloatArray, FloatArray, FloatArray]) -> tuple[Path, Path, Path]:
    imu, gnss, truth = tables
    return (
        write(tmp_path / "imu.csv", IMU, imu),
        write(tmp_path / "gnss.csv", GNSS, gnss),
        write(tmp_path / "truth.csv", GNSS, truth),
    )


def localize(*arguments: object) -> str:
    result = CliRunner().invoke(app, ["localize", *map(str, arguments)])
    if isinstance(result.exception, InvalidInputError):
        raise result.exception
    assert result.exit_code == 0, result.output
    return result.output


def test_a_log_is_localized_scored_and_drawn(logs: tuple[Path, Path, Path], tmp_path: Path) -> None:
    imu, gnss, truth = logs
    out = tmp_path / "there" / "report.html"
    output = localize("--imu", imu, "--gnss", gnss, "--truth", truth, "--sigma", 0.3, "--out", out, "--json")
    facts = json.loads(output)
    assert facts["within 0.5 m, %"] > 95.0
    assert facts["RMSE, m"] < 0.3
    assert facts["IMU samples"] == 6000
    page = out.read_text()
    assert page.count("plotly-graph-div") == 3
    assert "<script src" not in page


def test_without_a_truth_it_still_tells_how_surprising_the_fixes_were(logs: tuple[Path, Path, Path]) -> None:
    output = localize("--imu", logs[0], "--gnss", logs[1], "--sigma", 0.3, "--filter", "ekf")
    assert "mean NIS" in output
    assert "RMSE" not in output


def test_a_figure_that_cannot_be_written_costs_no_result(logs: tuple[Path, Path, Path], tmp_path: Path) -> None:
    out, no_folder = tmp_path / "report.html", logs[0]
    words = ["localize", "--imu", logs[0], "--gnss", logs[1], "--out", out, "--figure", no_folder / "figure.html"]
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert isinstance(result.exception, OSError)
    assert "mean NIS" in result.output
    assert out.exists()


def test_metres_do_as_well_as_degrees(logs: tuple[Path, Path, Path], tmp_path: Path) -> None:
    geodetic = read_positions(logs[1])
    plane = write(tmp_path / "xy.csv", "t,x,y,z", np.column_stack([geodetic.time, geodetic.position]))
    flat = write(tmp_path / "flat.csv", "t, x, y", np.column_stack([geodetic.time, geodetic.position[:, :2]]))
    np.testing.assert_allclose(read_positions(plane).position, geodetic.position, atol=1e-6)
    np.testing.assert_allclose(read_positions(flat).position[:, :2], geodetic.position[:, :2], atol=1e-6)
    assert read_positions(plane).origin is None
    with pytest.raises(InvalidInputError, match="both in degrees or both in metres"):
        localize("--imu", logs[0], "--gnss", logs[1], "--truth", plane)


def test_rows_without_a_fix_and_repeated_rows_are_left_out(tmp_path: Path) -> None:
    path = tmp_path / "gnss.csv"
    path.write_text(
        "t,lat,lon,alt\n0,43.5,7.0,10\n1,,,\n2,nan,7.0,10\n3,43.5001,7.0,10\n3,43.5001,7.0,10\n4,43.5002,7,10\n"
    )
    log = read_positions(path)
    assert log.time.tolist() == [0.0, 3.0, 4.0]
    np.testing.assert_allclose(log.position[1, :2], [0.0, 11.1], atol=0.1)


def scaled(columns: slice, by: float, table: FloatArray) -> FloatArray:
    table[:, columns] *= by
    return table


def without_gravity(table: FloatArray) -> FloatArray:
    table[:, 3] -= 9.81
    return table


def swapped_rows(table: FloatArray) -> FloatArray:
    table[[2000, 2001]] = table[[2001, 2000]]
    return table


def with_nans(table: FloatArray) -> FloatArray:
    table[::5, 2] = np.nan
    return table


def test_five_samples_a_second_are_enough_also_with_the_time_since_1970(tmp_path: Path) -> None:
    time = 1_600_000_000.0 + 0.2 * np.arange(200)
    rest = np.tile([0.0, 0.0, 9.81, 0.0, 0.0, 0.0], (len(time), 1))
    assert len(read_imu(write(tmp_path / "imu.csv", IMU, np.column_stack([time, rest]))).time) == 200


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: scaled(slice(1, 4), 1 / 9.81, t), "is it in g"),
        (without_gravity, "has gravity been taken out"),
        (lambda t: t[:, [0, 1, 3, 2, 4, 5, 6]], "gravity lies along y"),
        (lambda t: scaled(slice(3, 4), -1.0, t), "gravity lies along -z"),
        (lambda t: scaled(slice(4, 7), 57.29578, t), "is it in degrees/s"),
        (lambda t: scaled(slice(0, 1), 1000.0, t), "is t in milliseconds"),
        (swapped_rows, "time runs backwards, from t = 20.02"),
        (with_nans, "1200 of 6000 rows are repeated or have missing numbers"),
        (lambda t: np.delete(t, np.arange(2000, 2300), axis=0), "the IMU is silent for 3.01 s after t = 20.000"),
        (lambda t: t[:1], "expected at least 2 rows"),
    ],
)
def test_what_would_mislead_the_filter_is_refused(
    change: Callable[[FloatArray], FloatArray],
    message: str,
    tables: tuple[FloatArray, FloatArray, FloatArray],
    tmp_path: Path,
) -> None:
    path = write(tmp_path / "imu.csv", IMU, change(tables[0].copy()))
    with pytest.raises(InvalidInputError) as caught:
        read_imu(path)
    assert message in str(caught.value)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_few_bad_samples_are_bridged(tables: tuple[FloatArray, FloatArray, FloatArray], tmp_path: Path) -> None:
    table = np.insert(tables[0], 3000, tables[0][2999], axis=0)
    table[1000, 1] = np.nan
    log = read_imu(write(tmp_path / "imu.csv", IMU, table))
    assert len(log.time) == 5999
    assert (np.diff(log.time) > 0).all()


def test_swapped_coordinates_are_noticed_by_the_turns(logs: tuple[Path, Path, Path], tmp_path: Path) -> None:
    swapped = tmp_path / "swapped.csv"
    lines = [line.split(",") for line in logs[1].read_text().splitlines()]
    swapped.write_text("\n".join([GNSS, *(f"{t},{lon},{lat},{alt}" for t, lat, lon, alt in lines[1:])]))
    with pytest.raises(InvalidInputError, match=r"lat and lon .* swapped"):
        check_together(read_imu(logs[0]), read_positions(swapped))
    beyond = tmp_path / "beyond.csv"
    beyond.write_text(f"{GNSS}\n0,151.2,-33.8,0\n1,151.2,-33.8,0\n")
    with pytest.raises(InvalidInputError, match=r"latitudes from -90 to 90, got 151\.2: are lat and lon swapped"):
        read_positions(beyond)
    check_together(read_imu(logs[0]), read_positions(logs[1]))


def test_two_journeys_are_not_one(logs: tuple[Path, Path, Path], tmp_path: Path) -> None:
    gnss = read_positions(logs[1])
    later = write(tmp_path / "later.csv", "t,x,y", np.column_stack([gnss.time + 1000.0, gnss.position[:, :2]]))
    with pytest.raises(InvalidInputError, match=r"do not overlap in time: t is 0.010 to 60.000 s in one, 1000.100"):
        localize("--imu", logs[0], "--gnss", later)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("t,ax,ay,az,gx,gy\n0,0,0,0,0,0\n", "no column gz; expected t, ax, ay, az, gx, gy, gz"),
        ("t,ax,ay,az,gx,gy,gz\n0,x,0,0,0,0,0\n1,0,0,0,0,0,0\n", "conversion"),
        ("", "no column t"),
    ],
)
def test_broken_files_are_one_clear_line(content: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "imu.csv"
    path.write_text(content)
    with pytest.raises(InvalidInputError) as caught:
        read_imu(path)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("separator", "told"), [(";", "';'"), ("\t", "a tab")])
def test_columns_that_no_comma_separates_are_told(separator: str, told: str, tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("t,lat,lon\n0,5,43,5,7,1\n".replace(",", separator, 2))
    for read in (read_imu, read_positions):
        with pytest.raises(InvalidInputError, match=f"expected columns separated by commas, got {told} in line 1"):
            read(path)


def test_names_of_columns_may_be_in_quotes(tmp_path: Path) -> None:
    path = tmp_path / "gnss.csv"
    path.write_text('"t","lat","lon"\n0,43.5,7\n1,43.5001,7\n')
    assert read_positions(path).time.tolist() == [0.0, 1.0]


def test_missing_files_and_columns_of_positions_are_named(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match="cannot read"):
        read_positions(tmp_path / "nowhere.csv")
    path = tmp_path / "gnss.csv"
    path.write_text("t,latitude,longitude\n0,1,2\n")
    with pytest.raises(InvalidInputError, match="expected the columns t, lat, lon, alt or t, x, y, z"):
        read_positions(path)


@pytest.mark.parametrize("sigma_m", [0.05, 10.0])
def test_a_column_of_sigma_does_as_well_as_the_option(tmp_path: Path, sigma_m: float) -> None:
    """Also at a start at rest, and whatever the option says beside the column."""
    journey = journey_named("roundabout", 5.0, 60.0)
    noise = GnssNoise(sigma_m, correlated_share=0.0, rate_hz=1.0)
    recording = record(journey, ICM_20600, noise, np.random.default_rng(1))
    imu = write(tmp_path / "imu.csv", "t,ax,ay,az,gx,gy,gz", np.column_stack([journey.time, recording.imu]))
    truth = write(tmp_path / "truth.csv", "t,x,y", np.column_stack([journey.time, journey.position])[::10])
    fixes = np.column_stack([journey.time[recording.fix_rows.astype(int)], recording.fixes])
    plain = write(tmp_path / "plain.csv", "t,x,y,z", fixes)
    column = write(tmp_path / "column.csv", "t,x,y,z,sigma", np.column_stack([fixes, np.full(len(fixes), sigma_m)]))
    words = ("--imu", imu, "--truth", truth, "--no-smooth", "--json", "--gnss")
    told = [json.loads(localize(*words, plain, "--sigma", sigma_m))]
    told += [json.loads(localize(*words, column, *option)) for option in ((), ("--sigma", 1.0))]
    for one in told[1:]:
        assert one["RMSE, m"] == pytest.approx(told[0]["RMSE, m"])
        assert one["warnings"] == told[0]["warnings"]


@pytest.mark.parametrize(("wrong_m", "code"), [(5.0, "too-unsure"), (0.02, "too-sure")])
def test_a_warning_about_a_column_of_sigma_is_of_the_column(
    logs: tuple[Path, Path, Path], tmp_path: Path, wrong_m: float, code: str
) -> None:
    imu, gnss, _ = logs
    header, *lines = gnss.read_text().splitlines()
    wrong = tmp_path / "wrong.csv"
    wrong.write_text("\n".join([f"{header},sigma", *(f"{line},{wrong_m}" for line in lines)]) + "\n")
    texts = [
        next(
            one["text"]
            for one in json.loads(localize("--imu", imu, "--gnss", wrong, "--json", *option))["warnings"]
            if one["code"] == code
        )
        for option in ((), ("--sigma", 0.5))
    ]
    assert texts[0] == texts[1], "the option is not used"
    assert "the column sigma (about " in texts[0]
    assert "receiver's sigma" not in texts[0]
