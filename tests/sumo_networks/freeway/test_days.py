"""Days of segment speeds: real drives in meso and micro, and the dataset that they become."""

from __future__ import annotations

import json
import os
import signal
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import libsumo
import numpy as np
import polars as pl
import pytest
from pydantic import ValidationError

from dohyo.sumo_networks.errors import InvalidInputError, SimulationError, UnknownNameError
from dohyo.sumo_networks.freeway import dataset
from dohyo.sumo_networks.freeway.apart import drive_apart
from dohyo.sumo_networks.freeway.dataset import DatasetRequest, day_orders, make_dataset
from dohyo.sumo_networks.freeway.days import Measured, Scale, SpeedDay, drive_day
from dohyo.sumo_networks.freeway.scenario import DAY_S, Day, FreewayScenario, Incident
from dohyo.sumo_networks.scenario import Mission, Place, Scenario, Traffic
from tests import forked
from tests.conftest import Start

MORNING = FreewayScenario(seed=3, start_s=6 * 3600, duration_s=2.5 * 3600, warm_up_s=600)


def test_a_morning_in_meso_has_a_queue_before_the_bridge_and_none_after_it() -> None:
    shares: list[float] = []
    day = drive_day(MORNING, "meso", shares.append)
    assert day.minute[0] == 360
    assert day.truth.speed_mps.shape == (150, 21)
    peak = day.truth.speed_mps[70:130]
    assert np.median(peak[:, 13:16]) < 15
    assert np.median(peak[:, 18:]) > 24
    assert np.median(day.truth.speed_mps[:10]) > 24  # and nobody stood at six
    assert np.nanmax(day.truth.speed_mps) < 38
    flow = day.truth.left[70:130, 16].sum()
    assert 4800 < flow < 6200
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_probes_see_about_what_is_true() -> None:
    day = drive_day(MORNING.model_copy(update={"duration_s": 1200.0, "probes": 0.15}), "meso")
    seen = day.probes.seconds > 60
    assert seen.mean() > 0.9
    assert np.abs(day.probes.speed_mps - day.truth.speed_mps)[seen].mean() < 1.5
    assert day.probes.seconds.sum() / day.truth.seconds.sum() == pytest.approx(0.15, abs=0.02)


def test_single_vehicles_are_measured_the_same_way() -> None:
    early = MORNING.model_copy(update={"start_s": 5.2 * 3600, "duration_s": 180.0, "warm_up_s": 420.0})
    micro, meso = drive_day(early, "micro"), drive_day(early, "meso")
    assert np.nanmean(micro.truth.speed_mps) == pytest.approx(np.nanmean(meso.truth.speed_mps), rel=0.1)
    assert micro.truth.left.sum() == pytest.approx(meso.truth.left.sum(), rel=0.15)


def test_the_same_scenario_gives_the_same_day() -> None:
    short = MORNING.model_copy(update={"duration_s": 600.0})
    one, again = drive_day(short, "meso"), drive_day(short, "meso")
    assert np.array_equal(one.truth.speed_mps, again.truth.speed_mps, equal_nan=True)
    other = drive_day(short.model_copy(update={"seed": 4}), "meso")
    assert not np.array_equal(one.truth.speed_mps, other.truth.speed_mps, equal_nan=True)


def test_an_incident_in_meso_slows_its_segment_and_passes() -> None:
    incident = Incident(time_s=5.1 * 3600, duration_s=900, position_m=3000.0, lane=0)
    early = MORNING.model_copy(update={"start_s": 5 * 3600.0, "duration_s": 2700.0, "day": Day(incidents=(incident,))})
    speed = drive_day(early, "meso").truth.speed_mps[:, 5]
    assert np.nanmean(speed[8:20]) < 15
    assert np.nanmean(speed[30:]) > 22
    assert np.nanmean(speed[:5]) > 22


@pytest.mark.parametrize("swapped", [False, True])
def test_of_two_incidents_on_an_edge_in_meso_each_slows_it_while_it_lasts(swapped: bool) -> None:
    short = Incident(time_s=5.1 * 3600, duration_s=480, position_m=3000.0, lane=0)
    long = Incident(time_s=5.1 * 3600 + 300, duration_s=900, position_m=3050.0, lane=1)
    incidents = (long, short) if swapped else (short, long)
    early = MORNING.model_copy(update={"start_s": 5 * 3600.0, "duration_s": 2700.0, "day": Day(incidents=incidents)})
    speed = drive_day(early, "meso").truth.speed_mps[:, 5]
    assert np.nanmax(speed[8:24]) < 15  # from minute 6 to minute 26, whichever of the two is in force
    assert np.nanmean(speed[35:]) > 22
    assert np.nanmean(speed[:5]) > 22


MINUTE = MORNING.model_copy(update={"duration_s": 60.0, "warm_up_s": 0.0})


def test_an_incident_too_soon_is_refused_in_micro_and_left_out_of_a_drawn_morning() -> None:
    incident = Incident(time_s=MINUTE.start_s + 10.0, duration_s=60, position_m=9000.0, lane=0)
    soon = MINUTE.model_copy(update={"day": Day(incidents=(incident,))})
    with pytest.raises(InvalidInputError, match="a warm-up of at least"):
        drive_day(soon, "micro")
    drawn, without = drive_day(soon, "micro", drawn=True), drive_day(MINUTE, "micro")
    assert np.array_equal(drawn.truth.speed_mps, without.truth.speed_mps, equal_nan=True)


@pytest.mark.parametrize("scale", ["meso", "micro"])
@pytest.mark.parametrize("drawn", [False, True])
@pytest.mark.parametrize(
    ("position_m", "lane", "message"),
    [
        (50_000.0, 1, r"incident at 50000 m: expected a position in \[0, 11401\) m"),
        (-5000.0, 1, "incident at -5000 m: expected a position"),
        (5000.0, 9, "incident at 5000 m: expected a lane from 0 to 3, got 9"),
    ],
)
def test_an_incident_off_the_road_is_refused(
    scale: Scale, drawn: bool, position_m: float, lane: int, message: str
) -> None:
    incident = Incident(time_s=MINUTE.start_s, duration_s=600, position_m=position_m, lane=lane)
    with pytest.raises(InvalidInputError, match=message):
        drive_day(MINUTE.model_copy(update={"day": Day(incidents=(incident,))}), scale, drawn=drawn)


@pytest.mark.parametrize("duration_s", [1e-9, 20.0, 90.0])
def test_a_day_has_whole_minutes(duration_s: float) -> None:
    """Before, 20 s were a day without a minute, and the last of 90 s was demanded to its half."""
    with pytest.raises(InvalidInputError, match=f"expected a duration of whole minutes, got {duration_s:g} s"):
        drive_day(MINUTE.model_copy(update={"duration_s": duration_s}), "meso")
    rounded = MINUTE.model_copy(update={"start_s": 3 * 3600.0, "duration_s": 31 / 60 * 3600})
    assert rounded.duration_s % 60 > 0.0
    assert len(drive_day(rounded, "meso").minute) == 31


def test_a_failure_of_sumo_names_its_time_of_day(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_time_s: float) -> None:
        raise libsumo.TraCIException("no road")

    monkeypatch.setattr(libsumo, "simulationStep", fail)
    with pytest.raises(SimulationError, match="in the minute from 21600 to 21660 s since midnight: no road"):
        drive_day(MINUTE, "micro")
    assert not libsumo.isLoaded()


def test_a_process_drives_one_simulation_of_single_vehicles_at_a_time() -> None:
    libsumo.start(["sumo", "-n", str(dataset.load_freeway().network.path), "--no-step-log", "true"])
    with pytest.raises(SimulationError, match="another simulation of this process is still open"):
        drive_day(MINUTE, "micro")
    assert drive_day(MINUTE, "meso").minute.tolist() == [360]  # has a process of its own
    libsumo.close()
    drive_day(MINUTE, "micro")
    assert not libsumo.isLoaded()


def test_bicycles_drive_after_a_day_of_queues(start: Start) -> None:
    drive_day(MINUTE, "meso")
    mission = Mission(
        start=Place(lane="737320747#3_2", position_m=8.0), goal=Place(lane="726514449_2", position_m=-15.0)
    )
    traffic = Traffic(vehicles=40, bicycles=30, pedestrians=30, warm_up_s=5.0)
    _, world = start(Scenario(network="ingolstadt", missions=(mission,), traffic=traffic, seed=3))
    assert world.tick == 0


def test_what_the_other_process_raises_is_raised_here() -> None:
    with pytest.raises(UnknownNameError, match="no network named 'nowhere'"):
        drive_day(MINUTE.model_copy(update={"network": "nowhere"}), "meso")


def test_a_process_that_dies_is_one_clear_error() -> None:
    with pytest.raises(SimulationError, match="SUMO's own process ended with exit code -9"):
        drive_apart(_die, lambda _share: None)


def _die(_progress: object) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


DAY = f"""if True:
    import tempfile
    from dohyo.sumo_networks.freeway.days import drive_day
    from dohyo.sumo_networks.freeway.scenario import FreewayScenario

    scenario = FreewayScenario.model_validate_json({FreewayScenario(start_s=0.0, duration_s=DAY_S).model_dump_json()!r})
    tempfile.tempdir = None  # that of the server of `forked` was another one
    drive_day(scenario, "meso", lambda share: print(share, flush=True))
"""
DAYS = """if True:
    from pathlib import Path
    from dohyo.sumo_networks.freeway.dataset import DatasetRequest, make_dataset

    make_dataset(DatasetRequest(days=4, easy=0, hard=0), Path("days"), workers=2)
"""


def families(pid: int) -> list[int]:
    """A process and those below it."""
    try:
        tasks = [task.read_text().split() for task in Path(f"/proc/{pid}/task").glob("*/children")]
    except OSError:
        tasks = []
    return [pid, *(one for below in tasks for each in below for one in families(int(each)))]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_a_day_that_is_interrupted_leaves_no_files(number: signal.Signals, tmp_path: Path) -> None:
    """Neither where its process is interrupted, nor where the process that waits for it is killed."""
    process = forked.Python(DAY, env=os.environ | {"TMPDIR": str(tmp_path)})
    process.wait_for(lambda: "0.0" in process.output())
    assert list(tmp_path.glob("dohyo-day-*"))
    assert process.end(number) != 0
    ends = time.monotonic() + (0.0 if number == signal.SIGINT else 60.0)
    while left := list(tmp_path.glob("dohyo-day-*")):
        assert time.monotonic() < ends, left
        time.sleep(0.05)


def test_days_that_ctrl_c_interrupts_in_all_processes_leave_no_files(tmp_path: Path) -> None:
    """A terminal sends SIGINT to all processes, and the one that waits for them sends SIGTERM to its own."""
    process = forked.Python(DAYS, cwd=tmp_path, env=os.environ | {"TMPDIR": str(tmp_path)})
    process.wait_for(lambda: len(list(tmp_path.glob("dohyo-day-*/truth.xml"))) == 2)  # both are at work
    for pid in families(process.pid):
        with suppress(ProcessLookupError):  # the first ones may have ended those after them
            os.kill(pid, signal.SIGINT)
    assert process.end() != 0
    assert not list(tmp_path.glob("dohyo-day-*"))
    assert not list(tmp_path.rglob("*.parquet"))


# The dataset. What drives a day is replaced: its files are what is looked at.


@pytest.fixture
def driven(monkeypatch: pytest.MonkeyPatch) -> list[FreewayScenario]:
    """The scenarios that were driven, in order."""
    scenarios: list[FreewayScenario] = []

    def drive(scenario: FreewayScenario, scale: Scale, progress: Callable[[float], None], *, drawn: bool) -> SpeedDay:
        assert drawn
        scenarios.append(scenario)
        progress(1.0)
        minutes = round(scenario.duration_s / 60)
        speed = np.full((minutes, 21), 20.0 if scale == "meso" else 10.0)
        measured = Measured(speed, np.full_like(speed, 100.0), np.ones_like(speed))
        return SpeedDay(scenario.start_s / 60 + np.arange(minutes, dtype=np.float64), measured, measured)

    monkeypatch.setattr(dataset, "drive_day", drive)
    return scenarios


def test_the_sets_are_those_of_the_thesis(tmp_path: Path, driven: list[FreewayScenario]) -> None:
    assert make_dataset(DatasetRequest(days=3, easy=2, hard=4, mornings=2), tmp_path) == 11
    for split, number, minutes in (("train", 3, 1440), ("easy", 2, 1440), ("hard", 4, 440), ("mornings", 2, 440)):
        files = sorted((tmp_path / split).glob("*"))
        assert [file.name for file in files] == [f"day-{day:04}.parquet" for day in range(1, number + 1)]
        table = pl.read_parquet(files[0])
        assert table.height == minutes
        assert table.columns == [
            "minute",
            *(f"segment_{place:02}" for place in range(21)),
            *(f"truth_{place:02}" for place in range(21)),
        ]
        assert table["minute"].to_list() == list(range(table["minute"][0], table["minute"][0] + minutes))
        assert table["segment_00"].dtype == pl.Float32
    facts = json.loads((tmp_path / "dataset.json").read_text())
    assert facts["units"] == "m/s"
    assert len(facts["lengths_m"]) == 21
    assert facts["days"] == {"train": 3, "easy": 2, "hard": 4, "mornings": 2}
    assert len({scenario.seed for scenario in driven}) == 11


def test_what_is_there_is_kept_and_more_days_change_no_day(tmp_path: Path, driven: list[FreewayScenario]) -> None:
    make_dataset(DatasetRequest(days=2, easy=1, hard=1), tmp_path)
    before = {file: file.read_bytes() for file in tmp_path.glob("*/*.parquet")}
    (tmp_path / "train" / "day-0002.parquet").unlink()
    driven.clear()
    assert make_dataset(DatasetRequest(days=4, easy=1, hard=1), tmp_path) == 3
    assert len(driven) == 3
    assert all(file.read_bytes() == content for file, content in before.items())
    assert json.loads((tmp_path / "dataset.json").read_text())["days"]["train"] == 4


def test_a_day_that_fails_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> SpeedDay:
        raise SimulationError("SUMO failed")

    monkeypatch.setattr(dataset, "drive_day", fail)
    with pytest.raises(SimulationError):
        make_dataset(DatasetRequest(days=1, easy=0, hard=0), tmp_path)
    assert not list(tmp_path.glob("*/*"))


@pytest.mark.usefixtures("driven")
def test_another_order_does_not_mix_with_it(tmp_path: Path) -> None:
    make_dataset(DatasetRequest(days=1, easy=0, hard=0), tmp_path)
    for other in (DatasetRequest(days=1, easy=0, hard=0, seed=1), DatasetRequest(days=1, easy=0, hard=0, probes=0.5)):
        with pytest.raises(InvalidInputError, match=r"has a different dataset: expected (seed|probes)"):
            make_dataset(other, tmp_path)


def test_a_folder_that_cannot_be_is_one_clear_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InvalidInputError, match="cannot make a dataset in"):
        make_dataset(DatasetRequest(days=1), tmp_path / "file" / "inside")
    (tmp_path / "dataset.json").write_text("not json")
    with pytest.raises(InvalidInputError, match="cannot make a dataset in"):
        make_dataset(DatasetRequest(days=1), tmp_path)
    with pytest.raises(ValidationError):
        DatasetRequest(days=-1)


def test_hard_mornings_are_dense_weekdays_in_micro() -> None:
    hard = [one for one in day_orders(DatasetRequest(days=8)) if one.split == "hard"]
    train = [one for one in day_orders(DatasetRequest(days=8)) if one.split == "train"]
    assert [one.scale for one in hard] == ["micro"] * 4
    assert all(one.scenario.day.weekday < 5 and one.scenario.day.demand >= 1 for one in hard)
    assert {one.scenario.day.weekday for one in train} == set(range(7))
    assert {one.scale for one in train} == {"meso"}


def test_mornings_to_learn_from_are_drawn_as_the_hard_ones_and_are_others() -> None:
    orders = list(day_orders(DatasetRequest(days=0, easy=0, hard=3, mornings=3)))
    hard, mornings = ([one for one in orders if one.split == split] for split in ("hard", "mornings"))
    assert {one.scale for one in mornings} == {"micro"}
    assert [one.scenario.day.demand for one in mornings] == [one.scenario.day.demand for one in hard]
    assert not {one.scenario.seed for one in mornings} & {one.scenario.seed for one in hard}
    assert {one.scenario.duration_s for one in mornings} == {440 * 60.0}


@pytest.mark.slow
def test_days_are_the_same_however_many_make_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dataset, "DAY_S", 4 * 3600.0)
    order = DatasetRequest(days=0, easy=2, hard=0, seed=5)
    told: list[tuple[int, int]] = []
    assert make_dataset(order, tmp_path / "two", lambda done, of, _: told.append((done, of)), workers=2) == 2
    assert told == [(0, 2), (1, 2), (2, 2)]
    assert make_dataset(order.model_copy(update={"easy": 1}), tmp_path / "one") == 1
    made, again = (tmp_path / name / "easy" / "day-0001.parquet" for name in ("one", "two"))
    assert made.read_bytes() == again.read_bytes()
