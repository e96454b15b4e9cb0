"""Records of worlds that have ended are checked before they are sent, and signed."""

from __future__ import annotations

from pathlib import Path

import pytest

from dohyo.evaluation.records.store import seal, write_record
from dohyo.service.database.base import now
from dohyo.service.worlds.model import World, WorldStatus
from dohyo.service.worlds.records import record_path
from tests.evaluation.builders import drive, ego, episode
from tests.service.harness import Caller, Harness, assert_problem


@pytest.fixture
def kept(service: Harness) -> tuple[Caller, Path]:
    """The owner of a world with a record, and the record's path."""
    record = seal(episode(ego(progress_m=100.0)))
    path = record_path(service.services.settings, "wo-kept")
    path.parent.mkdir(exist_ok=True)
    write_record(path.parent, path.stem, record, drive())
    with service.services.database.session() as session:
        ended = {"status": WorldStatus.DONE, "finished": now(), "record_hash": record.record_hash, "kept_bytes": 2}
        session.add(World(id="wo-kept", owner="team", order={"network": "ingolstadt"}, **ended))
    return service.caller("team"), path


def test_a_whole_record_is_sent(kept: tuple[Caller, Path]) -> None:
    team, path = kept
    assert team.get("/v1/worlds/wo-kept/record").content == path.read_bytes()
    assert team.get("/v1/worlds/wo-kept/trajectory").content == path.with_suffix(".parquet").read_bytes()


def test_a_record_that_was_changed_or_is_of_another_world_is_not_signed(kept: tuple[Caller, Path]) -> None:
    team, path = kept
    path.write_bytes(path.read_bytes().replace(b"100.0", b"100.5"))
    assert_problem(team.get("/v1/worlds/wo-kept/record"), 410, "wo-kept")
    write_record(path.parent, path.stem, seal(episode(ego(progress_m=50.0))), drive())
    assert_problem(team.get("/v1/worlds/wo-kept/record"), 410, "wo-kept")
    assert_problem(team.get("/v1/worlds/wo-kept/trajectory"), 410, "wo-kept")


def test_trajectories_that_are_cut_off_or_away_are_gone(kept: tuple[Caller, Path]) -> None:
    team, path = kept
    table = path.with_suffix(".parquet")
    table.write_bytes(table.read_bytes()[:-10])
    assert_problem(team.get("/v1/worlds/wo-kept/trajectory"), 410, "wo-kept")
    table.unlink()
    assert_problem(team.get("/v1/worlds/wo-kept/trajectory"), 410, "wo-kept")
