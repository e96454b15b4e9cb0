"""Evaluation of agents that park: records, replay to the hash, rates, faults, page."""

from __future__ import annotations

import errno
import os
import re
import shutil
import signal
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from dohyo.evaluation.benchmarks.documents import benchmark_names
from dohyo.evaluation.families import Family
from dohyo.evaluation.parking import evaluate, running
from dohyo.evaluation.parking.benchmark import ParkingBenchmark, load_parking_benchmark
from dohyo.evaluation.parking.evaluate import PAGE, drive_again, evaluate_parking
from dohyo.evaluation.parking.lot_files import read_lots
from dohyo.evaluation.parking.motion import MOTION, read_motion
from dohyo.evaluation.parking.page import PLANS, Evaluated, shown_records, write_parking_page
from dohyo.evaluation.parking.record import RECORDS, ParkingRecord, read_records, write_records
from dohyo.evaluation.parking.result import compare_parking, summarise_parking
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.seeds import HELD_OUT_FROM
from tests.forked import Python

HERE = "tests.evaluation.parking.parkers"
SEEDS = range(HELD_OUT_FROM, HELD_OUT_FROM + 6)


def evaluated(
    out: Path, name: str = "parking-three", agent: str = "Greedy", settings: Mapping[str, Any] | None = None
) -> list[ParkingRecord]:
    return evaluate_parking(load_parking_benchmark(name), f"{HERE}:{agent}", settings or {}, "local", SEEDS, out)


@pytest.fixture(scope="module")
def three(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[ParkingRecord]]:
    folder = tmp_path_factory.mktemp("three") / "greedy"
    return folder, evaluated(folder)


def test_every_benchmark_loads_and_is_held_out():
    assert {f"parking-{scene}" for scene in ("simple", "complex", "three", "parallel", "angled", "pedestrians")} == {
        *benchmark_names(Family.PARKING)
    }
    loaded = [load_parking_benchmark(name) for name in benchmark_names(Family.PARKING)]
    assert len({one.sha256 for one in loaded}) == len(loaded)
    assert all(one.seeds == range(HELD_OUT_FROM, HELD_OUT_FROM + 2000) for one in loaded)


def test_a_benchmark_of_ones_own_and_wrong_ones(tmp_path):
    path = tmp_path / "mine.toml"
    head = 'kind = "parking"\nname = "mine"\ndescription = "d"\nmetric = "m"\n'
    path.write_text(head + 'scene = "angled"\nkarts = 2\nlots = 3\n')
    assert len(load_parking_benchmark(str(path)).seeds) == 3
    path.write_text(head + 'scene = "lunar"\n')
    with pytest.raises(InvalidInputError, match=r"scene: expected 'simple', 'complex', .* got 'lunar'"):
        load_parking_benchmark(str(path))
    path.write_text(head + 'scene = "parallel"\nkarts = 6\n')
    with pytest.raises(InvalidInputError, match="expected at most 5 karts in the scene 'parallel', got 6"):
        load_parking_benchmark(str(path))
    with pytest.raises(UnknownNameError, match="did you mean 'parking-angled'"):
        load_parking_benchmark("parking-angle")


def test_records_replay_to_their_hashes_and_an_edited_one_is_refused(three, tmp_path):
    folder, records = three
    assert drive_again(records) == [record.record_hash for record in records]
    text = (folder / RECORDS).read_text()
    edited = tmp_path / RECORDS
    edited.write_text(text.replace('"ending":"collided"', '"ending":"parked"', 1))
    with pytest.raises(InvalidInputError, match=r"line \d: the record has been changed"):
        read_records(edited)
    edited.write_text("")
    with pytest.raises(InvalidInputError, match="expected records of parking, got none"):
        read_records(edited)


def test_a_lot_that_comes_twice_is_refused(three, tmp_path):
    """Written ten times, the same lots would narrow the interval by a factor of three."""
    folder, records = three
    (tmp_path / RECORDS).write_text((folder / RECORDS).read_text() * 10)
    with pytest.raises(InvalidInputError, match=f"{RECORDS}': expected every lot once, .* seed {SEEDS[0]} 10 times"):
        read_records(tmp_path / RECORDS)
    (tmp_path / "fetched" / "records").mkdir(parents=True)
    for name in ("lot-s1.json", "lot-s2.json"):
        (tmp_path / "fetched" / "records" / name).write_text(records[0].model_dump_json())
    with pytest.raises(InvalidInputError, match=f"fetched': expected every lot once, got .* seed {SEEDS[0]} 2 times"):
        read_lots(tmp_path / "fetched")
    with pytest.raises(InvalidInputError, match="expected every lot once, got 3 seeds of 2 lots"):
        evaluate_parking(
            load_parking_benchmark("parking-three"), f"{HERE}:Greedy", {}, "local", [1, 2, 1], tmp_path / "out"
        )
    assert not (tmp_path / "out").exists()


def test_processes_drive_as_one_does(three, monkeypatch):
    _, records = three
    monkeypatch.setattr(running, "CHUNK", 3)
    told: list[tuple[int, int]] = []
    hashes = drive_again(records, workers=2, tell=lambda *counts: told.append(counts))
    assert hashes == [record.record_hash for record in records]
    assert told == [(lots, 6) for lots in range(1, 7)]


def test_motion_is_that_of_the_records(three, tmp_path):
    folder, records = three
    motions = read_motion(folder, records[:2])
    assert sorted(motions) == [record.seed for record in records[:2]]
    for record in records[:2]:
        motion = motions[record.seed]
        assert motion.shape[1:] == (3, 4)
        assert len(motion) == round(max(one.time_s for one in record.karts) / 0.1) + 1
    foreign = records[0].model_copy(update={"motion_sha256": "0" * 64})
    with pytest.raises(InvalidInputError, match="is not that of its record"):
        read_motion(folder, [foreign])
    assert read_motion(tmp_path, records) == {}


def test_a_complete_evaluation_is_read_and_another_one_refused(three):
    folder, records = three
    before = (folder / RECORDS).stat().st_mtime_ns
    assert evaluated(folder) == records
    assert (folder / RECORDS).stat().st_mtime_ns == before
    with pytest.raises(InvalidInputError, match="'greedy' as it was before its code or settings changed"):
        evaluated(folder, settings={"gain": 1.5})
    with pytest.raises(InvalidInputError, match="holds benchmark parking-three"):
        evaluated(folder, name="parking-simple")
    with pytest.raises(InvalidInputError, match=f"holds lot {SEEDS[4]}, which is not to be driven"):
        evaluate_parking(load_parking_benchmark("parking-three"), f"{HERE}:Greedy", {}, "local", SEEDS[:4], folder)


KILLED = """
import sys
from pathlib import Path
from dohyo.evaluation.parking import running
from dohyo.evaluation.parking.benchmark import load_parking_benchmark
from dohyo.evaluation.parking.evaluate import evaluate_parking
from tests.evaluation.parking.test_evaluate import HERE, MANY
running.CHUNK = 3
evaluate_parking(load_parking_benchmark("parking-simple"), f"{HERE}:Halting", {}, "local", MANY, Path(sys.argv[1]))
"""
MANY = range(HELD_OUT_FROM, HELD_OUT_FROM + 30)


def test_kill_nine_loses_no_lot_that_was_kept(tmp_path):
    out, simple = tmp_path / "killed", load_parking_benchmark("parking-simple")
    process = Python(KILLED, str(out), env=os.environ | {"HALTS_AT": str(MANY[15])})
    process.wait_for(lambda: len(list(out.glob(f"driven/*/{RECORDS}"))) >= 2)
    with pytest.raises(InvalidInputError, match="in use by another process"):
        evaluate_parking(simple, f"{HERE}:Halting", {}, "local", MANY, out)
    process.end(signal.SIGKILL)
    assert not (out / RECORDS).exists()
    with pytest.raises(InvalidInputError, match="or another agent"):
        evaluate_parking(simple, f"{HERE}:Greedy", {}, "local", MANY, out)
    told: list[tuple[int, int]] = []
    resumed = evaluate_parking(simple, f"{HERE}:Halting", {}, "local", MANY, out, tell=lambda *one: told.append(one))
    assert told[0] >= (7, 30)
    assert told[-1] == (30, 30)
    assert resumed == read_records(out / RECORDS)
    assert not (out / "driven").exists()
    assert resumed == evaluate_parking(simple, f"{HERE}:Halting", {}, "local", MANY, tmp_path / "undisturbed")
    assert (out / MOTION).read_bytes() == (tmp_path / "undisturbed" / MOTION).read_bytes()


def test_more_lots_complete_an_evaluation(three, tmp_path):
    _, records = three
    some = load_parking_benchmark("parking-three"), f"{HERE}:Greedy", {}, "local"
    evaluate_parking(*some, SEEDS[2:4], tmp_path)
    told: list[int] = []
    assert evaluate_parking(*some, SEEDS, tmp_path, tell=lambda done, _: told.append(done)) == records
    assert told == [3, 4, 5, 6]


def files_of(folder: Path) -> dict[str, bytes]:
    """Content of the files of a result, chunks included."""
    files = [path for path in folder.rglob("*") if path.is_file() and path.name != ".lock"]
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def refuse_to_write(*_: object) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_run_that_ends_while_it_writes_loses_nothing(three, tmp_path, monkeypatch):
    """The first lots have a result already, whose files must not be taken for those of all lots."""
    folder, records = three
    some = load_parking_benchmark("parking-three"), f"{HERE}:Greedy", {}, "local"
    evaluate_parking(*some, SEEDS[2:4], tmp_path)
    driven: list[int] = []
    for writer in ("write_motion", "write_records", "write_parking_page"):
        with monkeypatch.context() as full:
            full.setattr(evaluate, writer, refuse_to_write)
            with pytest.raises(OSError, match="No space left"):
                evaluate_parking(*some, SEEDS, tmp_path, tell=lambda done, _: driven.append(done))
    assert evaluate_parking(*some, SEEDS, tmp_path, tell=lambda done, _: driven.append(done)) == records
    assert driven == [3, 4, 5, 6]
    assert files_of(tmp_path) == files_of(folder)


def test_a_missing_report_alone_is_written_again(three, tmp_path):
    folder, records = three
    shutil.copytree(folder, tmp_path / "copy")
    (tmp_path / "copy" / PAGE).unlink()
    assert evaluated(tmp_path / "copy") == records
    assert files_of(tmp_path / "copy") == files_of(folder)


def of_version(records: list[ParkingRecord], version: str) -> list[ParkingRecord]:
    return [record.model_copy(update={"version": version}).sealed() for record in records]


def test_records_of_another_version_are_driven_again_also_beside_motion_of_this_one(three, tmp_path):
    """A run that ended between the two files leaves them so."""
    folder, records = three
    shutil.copytree(folder, tmp_path / "copy")
    foreign = [record.model_copy(update={"motion_sha256": "0" * 64}) for record in records]
    write_records(tmp_path / "copy", of_version(foreign, "0.9.0"))
    assert evaluated(tmp_path / "copy") == records
    assert files_of(tmp_path / "copy") == files_of(folder)


def test_versions_that_differ_are_all_named(three, tmp_path):
    _, records = three
    mixed = of_version(records[:3], "0.0.1") + of_version(records[3:], "0.0.2")
    both = [Evaluated("one", records, {}), Evaluated("two", mixed, {})]
    page = write_parking_page(tmp_path / "both.html", both).read_text()
    assert f"<dd>0.0.1, 0.0.2, {records[0].version}</dd>" in page
    said = "Take care: different versions drove these episodes, which alone may change scores. "
    assert f"{said}one: dohyo {records[0].version}; two: dohyo 0.0.1, 0.0.2." in page
    assert "Take care" not in write_parking_page(tmp_path / "one.html", [both[0], both[0]]).read_text()
    with pytest.raises(InvalidInputError, match=r"made by dohyo 0\.0\.2, .*: expected the same here"):
        drive_again([*records[:3], *of_version(records[3:], "0.0.2")])


def test_rates_count_karts_and_intervals_are_over_lots(three):
    _, records = three
    result, karts = summarise_parking(records), [one for record in records for one in record.karts]
    parked = [one for one in karts if one.ending == "parked"]
    assert 0 < len(parked) < len(karts) == 18
    success = result.estimates["success"]
    assert success.mean == pytest.approx(100 * len(parked) / 18)
    assert success.n == 18
    assert result.estimates["aligned"].mean == pytest.approx(100 * sum(one.aligned for one in parked) / len(parked))
    assert result.estimates["time_s"].mean == pytest.approx(sum(one.time_s for one in parked) / len(parked))
    assert sum(result.endings.values()) == 18
    assert sum(result.touched.values()) == result.endings["collided"]
    none = result.estimates["timed_out"]
    assert none.mean == 0.0
    assert 30 < none.high < 50  # no event in 6 lots, by Wilson


def test_a_parked_kart_that_is_hit_has_parked(three):
    """Only who drove into it ended in contact."""
    _, records = three
    first = next(record for record in records if any(one.ending == "parked" for one in record.karts))
    hit = [one.model_copy(update={"touched": "kart"}) if one.ending == "parked" else one for one in first.karts]
    before, after = summarise_parking([first]), summarise_parking([first.model_copy(update={"karts": tuple(hit)})])
    assert (after.estimates, after.touched) == (before.estimates, before.touched)


def test_agents_are_compared_on_common_lots(three, tmp_path):
    _, records = three
    other = evaluated(tmp_path / "other", agent="Broken")
    found = compare_parking(records, other)
    assert (found.probability, found.difference.n) == (None, 6)  # not all of the six differ
    assert found.difference.mean > 0.0
    assert compare_parking(records, records).verdict == "="
    with pytest.raises(InvalidInputError, match="common lots, got none"):
        compare_parking(records[:1], other[1:])


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        ("raise", "act raised ZeroDivisionError: no way"),
        ("exit", "act raised SystemExit: 0"),
        ("no machine", "act raised SimulationError: not my fault"),
        ([0.0, 1.0], r"expected 3 finite numbers as action, got shape \(2,\)"),
        ([0.0, float("nan"), 0.0], "expected 3 finite numbers"),
    ],
)
def test_a_failed_agent_has_not_parked_and_the_record_says_why(tmp_path, answer, said):
    records = evaluated(tmp_path / "out", "parking-simple", "Broken", {"answer": answer})
    for record in records:
        assert record.karts[0].ending == "failed"
        assert re.search(said, record.karts[0].failure)
    assert summarise_parking(records).estimates["success"].mean == 0.0


LOTS = SEEDS[:3]


# An agent that hangs waits it out; a healthy one on a busy machine is never so late.
DEADLINE_S = 5.0


def fatal(out: Path, **settings: Any) -> list[ParkingRecord]:
    three = load_parking_benchmark("parking-three")
    return evaluate_parking(three, f"{HERE}:Fatal", settings, "local", LOTS, out, act_deadline_s=DEADLINE_S)


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ("late", f"agent 'greedy' took longer than {DEADLINE_S:g} s"),
        ("deaf", "agent never returned; its process was ended"),
        ("exit", "the process died twice while the agent was called"),
    ],
)
def test_a_lot_in_which_the_agent_hangs_or_ends_its_process_has_failed_and_the_others_are_driven(
    fault: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(running, "KILL_GRACE_S", 0.2)
    records = fatal(tmp_path / fault, fault=fault, lot=LOTS[1])
    assert [(one.ending, one.failure) for one in records[1].karts] == [("failed", said)] * 3
    healthy = fatal(tmp_path / "healthy")
    assert [records[at].karts for at in (0, 2)] == [healthy[at].karts for at in (0, 2)]
    assert fatal(tmp_path / fault, fault=fault, lot=LOTS[1]) == records
    if fault == "exit":
        assert drive_again(records, workers=1) == [record.record_hash for record in records]


def test_a_process_that_dies_once_leaves_no_trace_in_the_records(tmp_path):
    settings = {"fault": "exit once", "lot": LOTS[1], "marker": str(tmp_path / "died")}
    died = fatal(tmp_path / "died-once", **settings)
    assert (tmp_path / "died").exists()
    assert died == fatal(tmp_path / "undisturbed", **settings)
    assert all(one.failure is None for record in died for one in record.karts)


def test_an_agent_that_ends_its_process_where_it_is_closed_ends_no_evaluation(tmp_path):
    records = evaluated(tmp_path / "out", "parking-simple", "ExitsInClose")
    assert [record.karts[0].ending == "failed" for record in records] == [False] * 5 + [True]


def test_a_privileged_agent_is_shown_the_lot(tmp_path):
    records = evaluated(tmp_path / "seer", "parking-simple", "Seer")
    assert all(record.karts[0].failure is None for record in records)
    assert records[0].agent.track == "privileged"


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ("tests.evaluation.parking.parkers:ParkingSpec", "setting 'name': expected text"),
        (
            "dohyo.agents.experts.reckless:Reckless",
            "benchmark 'parking-simple': expected agents that park .*, and 'reckless' has",
        ),
        ("tests.evaluation.parking.parkers:Nobody", "has no 'Nobody'"),
    ],
)
def test_what_cannot_park_is_refused(tmp_path, entry, said):
    with pytest.raises(InvalidInputError, match=said):
        evaluate_parking(load_parking_benchmark("parking-simple"), entry, {}, "local", SEEDS, tmp_path)


def test_the_page_shows_every_agent_with_plan_views(three, tmp_path):
    folder, records = three
    text = (folder / PAGE).read_text()
    assert text.count('<svg class="plan"') == 6
    assert text.count('class="kart kart-2"') == 6
    assert "greedy" in text
    assert "<script" not in text
    assert (folder / MOTION).exists()
    both = [Evaluated("one", records, {}), Evaluated("two", records, {})]
    page = write_parking_page(tmp_path / "both.html", both).read_text()
    assert 'one <span class="verdict">=</span> two' in page
    assert "<h2>Manoeuvres</h2>" not in page
    foreign = ParkingBenchmark.model_validate({**records[0].benchmark.model_dump(), "karts": 2})
    other = [record.model_copy(update={"benchmark": foreign}) for record in records]
    with pytest.raises(InvalidInputError, match="different benchmarks"):
        write_parking_page(tmp_path / "both.html", [both[0], Evaluated("two", other, {})])


def test_the_lots_of_a_report_are_chosen_without_a_comparison_of_records(three, monkeypatch):
    first = three[1][0]
    endings = {"parked": "nothing", "collided": "wall", "timed_out": "nothing"}
    karts = [
        tuple(one.model_copy(update={"ending": ending, "touched": touched}) for one in first.karts)
        for ending, touched in endings.items()
    ]
    many = [first.model_copy(update={"seed": seed, "karts": karts[seed % 3]}) for seed in range(60)]

    def compared(*_: object) -> bool:
        raise AssertionError("records are compared one by one, which takes the square of their number")

    monkeypatch.setattr(ParkingRecord, "__eq__", compared)
    shown = [(one.seed, one.karts[0].ending) for one in shown_records(many)]
    assert len(shown) == PLANS
    assert [ending for _, ending in shown[:2]] == ["collided", "timed_out"]
    assert [seed % 3 for seed, _ in shown[6:]] == [0, 0, 0], "parked ones come last"
