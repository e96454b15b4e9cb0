from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from dohyo.evaluation.records.trajectory import Trajectory, TrajectoryRecorder
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.world import ActorKind, World
from tests.evaluation.builders import drive, world


def record(*worlds: World) -> Trajectory:
    recorder = TrajectoryRecorder()
    for one in worlds:
        recorder.append(one)
    return recorder.finish()


def test_egos_and_actors_share_one_table() -> None:
    trajectory = record(world(0, active=(True, True), actors=(3,), x=12.5))
    assert trajectory.tick.tolist() == [0, 0, 0]
    assert trajectory.key.tolist() == [-1, -2, 3]
    assert trajectory.kind.tolist() == [ActorKind.EGO, ActorKind.EGO, ActorKind.CAR]
    assert trajectory.x.tolist() == [12.5, 12.5, 3.0]
    assert trajectory.y.tolist() == [0.0, 1.0, 3.0]
    assert trajectory.speed.tolist() == [10.0, 10.0, 8.0]
    assert trajectory.names == {-1: "ego0", -2: "ego1", 3: "car3"}


def test_only_egos_have_what_only_egos_know() -> None:
    trajectory = record(world(0, actors=(3,), x=12.5))
    for column, value in {"acceleration": -1.0, "steering": 0.25, "progress": 12.5, "lateral": 0.0}.items():
        values = getattr(trajectory, column)
        assert values.dtype == np.float32
        assert values[0] == value
        assert np.isnan(values[1])


def test_an_ego_is_recorded_up_to_the_tick_in_which_it_ended() -> None:
    trajectory = record(
        world(0, active=(True, True)),
        world(1, active=(True, False)),
        world(2, active=(True, False)),
        world(3, active=(False, False)),
        world(4, active=(False, False)),
    )
    assert trajectory.tick[trajectory.key == -1].tolist() == [0, 1, 2, 3]
    assert trajectory.tick[trajectory.key == -2].tolist() == [0, 1]


def test_values_are_copied() -> None:
    reused = world(0, actors=(3,))
    recorder = TrajectoryRecorder()
    recorder.append(reused)
    reused.actors.position[:] = 99.0
    reused.egos.active[:] = False
    recorder.append(dataclasses.replace(reused, tick=1))
    recorder.append(dataclasses.replace(reused, tick=2))
    trajectory = recorder.finish()
    assert trajectory.x[trajectory.key == 3].tolist() == [3.0, 99.0, 99.0]
    assert trajectory.tick[trajectory.key == -1].tolist() == [0, 1]


def test_it_grows_without_losing_a_row() -> None:
    keys = tuple(range(100))
    trajectory = record(*(world(tick, actors=keys, x=float(tick)) for tick in range(200)))
    assert len(trajectory) == 200 * 101
    assert trajectory.x[trajectory.key == -1].tolist() == list(range(200))
    assert np.isnan(trajectory.progress[trajectory.key >= 0]).all()
    assert trajectory.key.reshape(200, 101)[:, 1:].tolist() == [list(keys)] * 200


def test_it_is_read_only() -> None:
    with pytest.raises(ValueError, match="read-only"):
        drive().x[0] = 1.0
    with pytest.raises(TypeError):
        drive().names[5] = "car5"  # type: ignore[index]


def test_the_digest_is_of_values_and_names() -> None:
    assert drive().sha256() == drive().sha256()
    assert drive(21).sha256() != drive(20).sha256()
    moved = record(world(0, x=1.0))
    assert moved.sha256() != record(world(0, x=1.0 + 1e-6)).sha256()
    assert dataclasses.replace(moved, names={-1: "other"}).sha256() != moved.sha256()


def test_the_digest_is_the_same_for_every_nan() -> None:
    plus, minus = record(world(0, lateral=np.nan)), record(world(0, lateral=-np.nan))
    assert plus.sha256() == minus.sha256()


@pytest.mark.parametrize("trajectory", [drive(), TrajectoryRecorder().finish()], ids=["drive", "empty"])
def test_parquet_keeps_everything(trajectory: Trajectory, tmp_path: Path) -> None:
    path = tmp_path / "drive.parquet"
    trajectory.write_parquet(path)
    again = Trajectory.read_parquet(path)
    assert again.sha256() == trajectory.sha256()
    assert again.names == trajectory.names
    assert not again.x.flags.writeable


def test_parquet_speaks_for_itself(tmp_path: Path) -> None:
    drive().write_parquet(tmp_path / "drive.parquet")
    table = pl.read_parquet(tmp_path / "drive.parquet")
    assert table.columns[:4] == ["tick", "key", "name", "kind"]
    assert table.filter(pl.col("key") == 7)["name"].unique().to_list() == ["car7"]


def test_names_take_little_room(tmp_path: Path) -> None:
    keys = tuple(range(100))
    record(*(world(tick, actors=keys) for tick in range(300))).write_parquet(tmp_path / "long.parquet")
    assert (tmp_path / "long.parquet").stat().st_size < 100_000


def test_what_is_no_trajectory_is_rejected(tmp_path: Path) -> None:
    path = tmp_path / "drive.parquet"
    with pytest.raises(InvalidInputError, match=r"drive\.parquet: expected"):
        Trajectory.read_parquet(path)
    path.write_bytes(b"no parquet")
    with pytest.raises(InvalidInputError, match="cannot be read"):
        Trajectory.read_parquet(path)
    drive().write_parquet(path)
    table = pl.read_parquet(path)
    for wrong, message in [
        (table.drop("lateral"), "columns"),
        (table.with_columns(pl.col("tick").cast(pl.Int64)), "'tick' as int32, got int64"),
        (table.with_columns(pl.lit(None, pl.Float32).alias("x")), "without nulls"),
        (table.with_columns(pl.col("tick").cast(pl.String).alias("name")), "one name per key"),
    ]:
        wrong.write_parquet(path)
        with pytest.raises(InvalidInputError, match=message):
            Trajectory.read_parquet(path)


def test_lights_are_recorded_at_the_start_and_where_they_change(tmp_path: Path) -> None:
    lights = [np.array(states) for states in ([1, 3], [1, 3], [1, 2], [3, 2])]
    worlds = [dataclasses.replace(world(tick), signals=states) for tick, states in enumerate(lights)]
    trajectory = record(*worlds)
    assert trajectory.signals.tolist() == [[0, 0, 1], [0, 1, 3], [2, 1, 2], [3, 0, 3]]
    trajectory.write_parquet(tmp_path / "t.parquet")
    back = Trajectory.read_parquet(tmp_path / "t.parquet")
    assert back.signals.tolist() == trajectory.signals.tolist()
    assert (
        back.sha256()
        == trajectory.sha256()
        != record(*worlds[:3], dataclasses.replace(worlds[3], signals=lights[2])).sha256()
    )


def test_broken_signals_are_refused(tmp_path: Path) -> None:
    drive().write_parquet(tmp_path / "t.parquet")
    table = pl.read_parquet(tmp_path / "t.parquet")
    table.write_parquet(tmp_path / "broken.parquet", metadata={"dohyo:signals": "[[1, 2]]"})
    with pytest.raises(InvalidInputError, match="lights' changes"):
        Trajectory.read_parquet(tmp_path / "broken.parquet")
