from __future__ import annotations

import json
import os
import signal
import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from dohyo.evaluation.records.record import AgentInfo, EpisodeRecord
from dohyo.evaluation.records.specifications import InfractionKind, Status
from dohyo.evaluation.records.store import read_record, read_records, read_trajectory, seal, write_record
from dohyo.evaluation.records.trajectory import Trajectory
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.scenario import content_hash
from tests.evaluation.builders import AGENT, drive, ego, episode, infraction, lost
from tests.forked import Python

OUTSIDE_THE_HASH = ("record_hash", "timing", "parquet_sha256")


def a_record(**rest: Any) -> EpisodeRecord:
    red = infraction(InfractionKind.RED_LIGHT, time_s=0.1 + 0.2, actor="Kreuzung Süd", route_m=1e-7)
    return seal(episode(ego(red, status=Status.COMPLETED, failure="straße"), **rest))


@pytest.fixture
def written(tmp_path: Path) -> Path:
    return write_record(tmp_path, "one", a_record(), drive())


def rewrite(path: Path, change: Callable[[dict[str, Any]], Any]) -> None:
    document = json.loads(path.read_bytes())
    change(document)
    path.write_text(json.dumps(document))


def test_the_hash_covers_the_facts_and_not_the_clock() -> None:
    record = a_record()
    assert len(record.record_hash) == 64
    assert seal(record) == record
    assert a_record(timing=None).record_hash == record.record_hash
    assert a_record(seed=1).record_hash != record.record_hash
    assert a_record(trajectory=drive(21)).record_hash != record.record_hash


def test_what_was_written_is_read(written: Path) -> None:
    assert read_record(written) == a_record()
    assert read_trajectory(written).sha256() == drive().sha256()
    assert sorted(path.name for path in written.parent.iterdir()) == ["one.json", "one.parquet"]


def test_a_record_replaces_the_one_before(written: Path) -> None:
    write_record(written.parent, "one", a_record(seed=5, trajectory=drive(30)), drive(30))
    assert read_record(written).scenario.seed == 5
    assert len(set(read_trajectory(written).tick.tolist())) == 30


def test_a_folder_is_read_in_order_of_names(written: Path) -> None:
    for stem, seed in [("two.1", 2), ("three", 3)]:
        write_record(written.parent, stem, a_record(seed=seed), drive())
    (written.parent / ".four.json.77.tmp").write_text("{")
    (written.parent / ".hidden.json").write_text("{")
    assert [record.scenario.seed for record in read_records(written.parent)] == [0, 3, 2]
    with pytest.raises(InvalidInputError, match="folder of records"):
        read_records(written.parent / "nowhere")


@pytest.mark.parametrize("failing", ["one.parquet", "one.json"])
@pytest.mark.parametrize("before", [False, True], ids=["fresh", "replacing"])
def test_a_write_that_fails_half_way_leaves_nothing(
    failing: str, before: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if before:
        write_record(tmp_path, "one", a_record(seed=9), drive())
    replace = os.replace

    def fail(source: Path, target: Path) -> None:
        if target.name == failing:
            raise OSError(28, "No space left on device")
        replace(source, target)

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(OSError, match="No space left"):
        write_record(tmp_path, "one", a_record(), drive())
    assert list(tmp_path.iterdir()) == []
    assert read_records(tmp_path) == []


def test_a_write_that_cannot_be_serialised_touches_nothing(written: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(self: Trajectory, target: object) -> None:
        raise MemoryError

    monkeypatch.setattr(Trajectory, "write_parquet", fail)
    with pytest.raises(MemoryError):
        write_record(written.parent, "one", a_record(seed=5), drive())
    assert read_record(written) == a_record()


@pytest.mark.parametrize("call", range(1, 9))
def test_a_killed_process_leaves_a_whole_record_or_none(call: int, tmp_path: Path) -> None:
    """The process kills itself just before its n-th system call that changes the disk."""
    if call % 2:
        write_record(tmp_path, "one", a_record(seed=9, trajectory=drive(30)), drive(30))
    code = f"""
        import os, signal
        from pathlib import Path
        from dohyo.evaluation.records.store import seal, write_record
        from tests.evaluation.builders import drive
        from tests.evaluation.records.test_store import a_record
        record, trajectory, calls = a_record(), drive(), 0
        def counted(function):
            def call(*args, **kwargs):
                global calls
                calls += 1
                if calls == {call}:
                    os.kill(os.getpid(), signal.SIGKILL)
                return function(*args, **kwargs)
            return call
        for name in ("fsync", "replace", "unlink"):
            setattr(os, name, counted(getattr(os, name)))
        write_record(Path({str(tmp_path)!r}), "one", record, trajectory)
        """
    process = Python(textwrap.dedent(code))
    assert process.end() == -signal.SIGKILL, process.errors()
    records = read_records(tmp_path)
    assert len(records) <= 1
    for record in records:
        assert read_trajectory(tmp_path / "one.json").sha256() == record.trajectory_sha256


def test_a_flipped_byte_of_the_facts_is_detected_or_changes_nothing(written: Path) -> None:
    whole, facts, silent = written.read_bytes(), a_record(timing=None), 0
    timing = range(whole.index(b'"timing"'), len(whole))
    for i in range(len(whole)):
        written.write_bytes(whole[:i] + bytes([whole[i] ^ 1]) + whole[i + 1 :])
        try:
            record = read_record(written)
        except InvalidInputError:
            continue
        assert record.model_copy(update={"timing": None}) == facts
        silent += i not in timing
    assert silent <= 1  # the last digit of 0.1 + 0.2, beyond a double's precision


def test_every_flipped_byte_of_the_trajectories_is_detected(written: Path) -> None:
    table = written.with_suffix(".parquet")
    whole = table.read_bytes()
    for i in range(0, len(whole), 11):
        table.write_bytes(whole[:i] + bytes([whole[i] ^ 64]) + whole[i + 1 :])
        with pytest.raises(InvalidInputError, match=r"one\.parquet: changed"):
            read_trajectory(written)


def test_every_truncation_is_detected(written: Path) -> None:
    whole, table = written.read_bytes(), written.with_suffix(".parquet").read_bytes()
    for length in range(0, len(whole) - 1, 13):
        written.write_bytes(whole[:length])
        with pytest.raises(InvalidInputError, match=r"one\.json: expected the JSON .* truncated"):
            read_record(written)
    written.write_bytes(whole)
    written.with_suffix(".parquet").write_bytes(table[:-1])
    with pytest.raises(InvalidInputError, match="truncated"):
        read_trajectory(written)


def test_tampering_is_named(written: Path) -> None:
    rewrite(written, lambda document: document["egos"][0].update(infractions=[]))
    with pytest.raises(InvalidInputError, match=r"one\.json: changed since it was written: expected facts with hash"):
        read_record(written)


def test_timing_may_change(written: Path) -> None:
    rewrite(written, lambda document: document.update(timing=None))
    assert read_record(written).timing is None


def test_trajectories_of_another_episode_are_detected(written: Path) -> None:
    other = write_record(written.parent, "two", a_record(trajectory=drive(30)), drive(30))
    other.with_suffix(".parquet").replace(written.with_suffix(".parquet"))
    with pytest.raises(InvalidInputError, match=r"one\.parquet: changed"):
        read_trajectory(written)
    with pytest.raises(InvalidInputError, match=r"two\.parquet: expected the trajectories of two\.json"):
        read_trajectory(other)


@pytest.mark.parametrize("text", ["", "[]", "{}", "7", "null", '{"a": NaN}', "\xff"])
def test_what_is_no_record_is_rejected(text: str, tmp_path: Path) -> None:
    path = tmp_path / "one.json"
    path.write_bytes(text.encode("latin-1"))
    with pytest.raises(InvalidInputError, match=r"one\.json: expected"):
        read_record(path)


def test_a_missing_record_is_named(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match=r"one\.json: expected an episode record, and there is no such file"):
        read_record(tmp_path / "one.json")
    with pytest.raises(InvalidInputError, match="cannot be read"):
        read_record(tmp_path)


def test_a_sealed_record_of_another_shape_is_rejected(written: Path) -> None:
    def reshape(document: dict[str, Any]) -> None:
        document["egos"][0]["colour"] = "red"
        document["record_hash"] = content_hash({key: document[key] for key in document if key not in OUTSIDE_THE_HASH})

    rewrite(written, reshape)
    with pytest.raises(InvalidInputError, match=r"this version of dohyo writes it: egos\.0\.colour: unknown key"):
        read_record(written)


def test_only_sealed_records_with_their_own_trajectory_are_written(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match="sealed"):
        write_record(tmp_path, "one", episode(), drive())
    with pytest.raises(InvalidInputError, match="sealed"):
        write_record(tmp_path, "one", a_record().model_copy(update={"ticks": 1}), drive())
    with pytest.raises(InvalidInputError, match="trajectory_sha256"):
        write_record(tmp_path, "one", a_record(), drive(3))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("stem", ["", ".", "..", "a/b", "/etc/passwd", ".hidden"])
def test_a_stem_is_a_plain_file_name(stem: str, tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match="file name"):
        write_record(tmp_path, stem, a_record(), drive())


def test_what_json_cannot_hold_is_not_sealed() -> None:
    odd = AgentInfo(**{**AGENT.model_dump(), "settings": {"gap_s": object()}})
    with pytest.raises(InvalidInputError, match="not plain JSON"):
        seal(episode(ego(agent=odd)))
    broken = ego().model_copy(update={"driven_m": float("nan")})
    with pytest.raises(InvalidInputError, match="not plain JSON"):
        seal(episode().model_copy(update={"egos": (broken,)}))


def test_a_lost_episode_is_a_record_too(tmp_path: Path) -> None:
    path = write_record(tmp_path, "one", seal(lost()), drive())
    assert read_record(path).egos[0].status.infrastructure_fault
