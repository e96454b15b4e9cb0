"""Evaluations in real processes: order, number of workers, crashes and kills change nothing."""

from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import time
from pathlib import Path

import pytest
import sumo

from dohyo.evaluation.benchmarks.benchmark import Benchmark
from dohyo.evaluation.benchmarks.headline import Headline
from dohyo.evaluation.records.specifications import Status
from dohyo.evaluation.running import executors, run
from dohyo.evaluation.running.executors import ProcessPool
from dohyo.evaluation.running.lock import held
from dohyo.evaluation.running.manifest import part_of_record
from dohyo.evaluation.running.run import Result, read_result, run_benchmark
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.scenario import Mission, Place, Traffic
from tests.forked import Python, dohyo

STEADY = "tests.evaluation.agents:Steady"


def benchmark(missions: int = 2, goal_m: float = 40.0) -> Benchmark:
    """Short drives along one street of Ingolstadt, among others."""
    return Benchmark(
        name="short",
        description="for tests",
        headline=Headline.DRIVING_SCORE,
        metric="driving score",
        network="ingolstadt",
        traffic=Traffic(vehicles=10, pedestrians=10, warm_up_s=5.0),
        missions=tuple(
            Mission(
                name=f"drive-{i}",
                start=Place(lane="737320747#3_2", position_m=5.0 + 10 * i),
                goal=Place(lane="737320747#4_2", position_m=goal_m),
            )
            for i in range(missions)
        ),
        seeds=(0, 1),
    )


def hashes(result: Result) -> list[str]:
    return [record.record_hash for record in result.records]


@pytest.mark.parametrize("agent", ["Plain", "NeverCloses"])
def test_a_class_without_a_base_drives(agent: str, tmp_path: Path) -> None:
    (record, *_) = run_benchmark(benchmark(1), f"tests.evaluation.agents:{agent}", out=tmp_path, seeds=[0]).records
    assert record.egos[0].driven_m > 5.0, record.egos[0].failure
    assert not record.egos[0].failure


@pytest.mark.parametrize(
    ("agent", "why"), [("WithDict", "expected an AgentSpec, got dict"), ("Slotted", "derive it from")]
)
def test_one_that_cannot_be_completed_is_refused_before_anything_is_written(
    agent: str, why: str, tmp_path: Path
) -> None:
    with pytest.raises(InvalidInputError, match=why):
        run_benchmark(benchmark(1), f"tests.evaluation.agents:{agent}", out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_order_and_number_of_workers_change_no_hash(tmp_path: Path) -> None:
    one = run_benchmark(benchmark(), STEADY, out=tmp_path / "one")
    two = run_benchmark(benchmark(), STEADY, out=tmp_path / "two", executor=ProcessPool(2))
    reverse = run_benchmark(benchmark(), STEADY, out=tmp_path / "reverse", reverse=True)
    assert hashes(one) == hashes(two) == hashes(reverse)
    assert len(set(hashes(one))) == 4


@pytest.mark.slow
def test_twelve_episodes_in_one_process_equal_twelve_fresh_processes(tmp_path: Path) -> None:
    short = benchmark(missions=3, goal_m=10.0)
    seeds = range(4)
    together = run_benchmark(short, STEADY, seeds=seeds, out=tmp_path / "together")
    alone = []
    for seed in seeds:
        for mission in short.missions["all"]:
            single = short.model_copy(update={"missions": {"all": (mission,)}})
            result = run_benchmark(single, STEADY, seeds=[seed], out=tmp_path / f"alone-{seed}-{mission.name}")
            alone.append(result.records[0])
    # The benchmark's name and hash differ, so compare what was driven.
    assert [r.trajectory_sha256 for r in together.records] == [r.trajectory_sha256 for r in alone]
    assert [r.egos for r in together.records] == [r.egos for r in alone]


def test_run_again_does_nothing_and_loses_nothing(tmp_path: Path) -> None:
    first = run_benchmark(benchmark(), STEADY, out=tmp_path)
    stamps = [path.stat().st_mtime_ns for path in first.paths]
    again = run_benchmark(benchmark(), STEADY, out=tmp_path)
    assert again.resumed == 4
    assert hashes(again) == hashes(first) == hashes(read_result(tmp_path))
    assert [path.stat().st_mtime_ns for path in again.paths] == stamps


def test_a_damaged_record_is_driven_again(tmp_path: Path) -> None:
    first = run_benchmark(benchmark(), STEADY, out=tmp_path)
    _, facts, short, gone = first.paths
    facts.write_text(facts.read_text()[:-200])
    short.with_suffix(".parquet").write_bytes(short.with_suffix(".parquet").read_bytes()[:-1])
    gone.with_suffix(".parquet").unlink()
    again = run_benchmark(benchmark(), STEADY, out=tmp_path)
    assert again.resumed == 1
    assert hashes(again) == hashes(first) == hashes(read_result(tmp_path))


def test_records_of_another_agent_or_benchmark_are_driven_again(tmp_path: Path) -> None:
    """The manifest, which would refuse them, is gone."""
    short = benchmark(missions=1, goal_m=10.0)
    first = run_benchmark(short, STEADY, out=tmp_path)
    (tmp_path / "evaluation.json").unlink()
    other = run_benchmark(short, STEADY, settings={"after": 3}, out=tmp_path)
    assert other.resumed == 0
    assert [record.egos[0].agent.settings for record in other.records] == [{"after": 3}] * 2
    (tmp_path / "evaluation.json").unlink()
    renamed = short.model_copy(update={"name": "renamed"})
    again = run_benchmark(renamed, STEADY, settings={"after": 3}, out=tmp_path)
    assert again.resumed == 0
    assert {record.benchmark for record in again.records} == {("renamed", renamed.sha256)}
    (tmp_path / "evaluation.json").unlink()
    assert run_benchmark(renamed, STEADY, settings={"after": 3}, out=tmp_path).resumed == 2
    assert hashes(first) == hashes(run_benchmark(short, STEADY, out=tmp_path / "alone"))


def test_one_failing_episode_leaves_the_others(tmp_path: Path) -> None:
    result = run_benchmark(benchmark(), "tests.evaluation.agents:FailsOnSeedOne", out=tmp_path)
    statuses = [record.egos[0].status for record in result.records]
    assert statuses[2:] == [Status.AGENT_RAISED] * 2
    assert all(status.completed for status in statuses[:2])


def test_a_dead_worker_is_replaced_and_its_episode_driven_again(tmp_path: Path) -> None:
    dies_once = "tests.evaluation.agents:DiesOnce"
    settings = {"marker": str(tmp_path / "marker")}
    crashed = run_benchmark(benchmark(), dies_once, settings=settings, out=tmp_path / "crashed")
    whole = run_benchmark(benchmark(), dies_once, settings=settings, out=tmp_path / "whole")
    assert hashes(crashed) == hashes(whole)


def test_an_episode_whose_process_always_dies_is_lost_and_not_the_agents_fault(tmp_path: Path) -> None:
    single = benchmark(missions=1)
    result = run_benchmark(single, "tests.evaluation.agents:DiesAlways", seeds=[0], out=tmp_path)
    (ego,) = result.records[0].egos
    assert ego.status is Status.SIMULATION
    assert "-9" in (ego.failure or "")
    assert run_benchmark(single, "tests.evaluation.agents:DiesAlways", seeds=[0], out=tmp_path).resumed == 0


def test_an_agent_that_never_returns_is_ended_and_at_fault(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(executors, "KILL_GRACE_S", 0.5)
    result = run_benchmark(
        benchmark(missions=1),
        "tests.evaluation.agents:HangsOutsidePython",
        out=tmp_path,
        seeds=[0],
        act_deadline_s=0.5,
    )
    assert result.records[0].egos[0].status is Status.AGENT_DEADLINE


@pytest.mark.parametrize("name", ["Exits", "Interrupts", "BlamesTheMachine"])
def test_an_agent_that_ends_its_process_or_blames_the_machine_is_at_fault(name: str, tmp_path: Path) -> None:
    entry, single = f"tests.evaluation.agents:{name}", benchmark(missions=1)
    result = run_benchmark(single, entry, settings={"after": 3}, seeds=[0], out=tmp_path)
    assert result.records[0].egos[0].status is Status.AGENT_RAISED
    assert run_benchmark(single, entry, settings={"after": 3}, seeds=[0], out=tmp_path).resumed == 1


@pytest.mark.parametrize("name", ["FailsToClose", "ExitsInClose"])
def test_an_agent_that_cannot_be_closed_has_driven_all_the_same(name: str, tmp_path: Path) -> None:
    result = run_benchmark(benchmark(missions=1), f"tests.evaluation.agents:{name}", seeds=[0], out=tmp_path)
    assert result.records[0].egos[0].status.completed


def test_a_record_that_cannot_be_written_ends_the_evaluation_and_the_same_call_continues(tmp_path: Path) -> None:
    out, notes, short = tmp_path / "out", tmp_path / "notes", benchmark(missions=1, goal_m=10.0)
    occupied = out / "records" / "drive-0-s1.json"
    occupied.mkdir(parents=True)
    noted, settings = "tests.evaluation.agents:Noted", {"file": str(notes)}
    with pytest.raises(InvalidInputError, match=r"cannot write results to '.*records': .*; the same command continues"):
        run_benchmark(short, noted, settings=settings, seeds=[0, 1, 2], out=out)
    assert notes.read_bytes() == b"..", "each episode was driven once, and none after the failure"
    assert finished(out) == {"drive-0-s0.json", "drive-0-s1.json"}

    occupied.rmdir()
    again = run_benchmark(short, noted, settings=settings, seeds=[0, 1, 2], out=out)
    assert again.resumed == 1
    assert all(record.egos[0].status.completed for record in again.records)


def test_a_lost_episode_whose_record_cannot_be_written_ends_the_evaluation(tmp_path: Path) -> None:
    (tmp_path / "records" / "drive-0-s0.json").mkdir(parents=True)
    with pytest.raises(InvalidInputError, match="cannot write results to"):
        run_benchmark(benchmark(missions=1), "tests.evaluation.agents:DiesAlways", seeds=[0], out=tmp_path)


def test_a_folder_that_cannot_hold_the_manifest_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(path: Path, content: bytes) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(run, "write_atomically", refuse)
    with pytest.raises(InvalidInputError, match=r"cannot write results to '.*': No space left on device"):
        run_benchmark(benchmark(missions=1), STEADY, seeds=[0], out=tmp_path)


def test_a_folder_that_another_process_uses_is_refused_and_nothing_is_driven(tmp_path: Path) -> None:
    out, settings = tmp_path / "out", {"file": str(tmp_path / "notes")}
    with held(out), pytest.raises(InvalidInputError, match=r"'.*out' is in use by another process: wait until it ends"):
        run_benchmark(benchmark(missions=1), "tests.evaluation.agents:Noted", settings=settings, seeds=[0], out=out)
    assert [path.name for path in out.iterdir()] == [".lock"]
    assert not (tmp_path / "notes").exists()


SHORT = """
name = "short"
description = "for tests"
headline = "driving_score"
metric = "driving score"
network = "ingolstadt"
traffic = { vehicles = 10, pedestrians = 10, warm_up_s = 5.0 }
seeds = [0, 1, 2, 3, 4, 5]

[[missions]]
name = "along"
start = { lane = "737320747#3_2", position_m = 5.0 }
goal = { lane = "737320747#4_2", position_m = 40.0 }
"""
HALTING = "tests.evaluation.agents:Halting"


def evaluating(benchmark: Path, out: Path) -> Python:
    """A command that has four episodes soon, and the other two not for minutes."""
    arguments = ["--agent", HALTING, "--benchmark", str(benchmark), "--json", "--workers", "2", "--out", str(out)]
    return dohyo("evaluate", *arguments, env=os.environ | {"HALTS_FROM": "4"})


def finished(out: Path) -> set[str]:
    return {path.name for path in (out / "records").glob("*.json")} if out.exists() else set()


def workers_of(pid: int) -> list[int]:
    """Its worker processes: the children of the server that forks them."""
    return [worker for server in children(pid, "multiprocessing.forkserver") for worker in children(server)]


def children(pid: int, pattern: str = "") -> list[int]:
    found = subprocess.run(["pgrep", "-P", str(pid), "-f", pattern], capture_output=True, text=True, check=False)
    return [int(line) for line in found.stdout.split()]


@pytest.mark.slow
def test_kill_nine_of_a_worker_and_of_the_command_lose_nothing(tmp_path: Path) -> None:
    short, out = tmp_path / "short.toml", tmp_path / "killed"
    short.write_text(SHORT)
    undisturbed = run_benchmark(str(short), HALTING, out=tmp_path / "undisturbed")
    process = evaluating(short, out)
    process.wait_for(lambda: len(finished(out)) >= 1)
    os.kill(workers_of(process.pid)[0], signal.SIGKILL)
    process.wait_for(lambda: len(finished(out)) >= 3 and len(workers_of(process.pid)) == 2)
    workers = workers_of(process.pid)
    process.end(signal.SIGKILL)
    before = finished(out)
    assert len(before) < 6, "it finished before the kill; the test shows nothing"
    patience = time.monotonic() + 120
    while any(Path(f"/proc/{pid}").exists() for pid in workers):
        assert time.monotonic() < patience, "workers outlive their parent"
        time.sleep(0.05)

    again = run_benchmark(str(short), HALTING, out=out)
    assert again.resumed == len(before)
    assert hashes(again) == hashes(undisturbed)
    # What a killed process was writing is left under a name that no listing of results shows.
    assert all(path.name.startswith(".") for path in (out / "records").glob("*.tmp"))


def test_another_benchmark_in_the_same_folder_is_refused(tmp_path: Path) -> None:
    run_benchmark(benchmark(missions=1), STEADY, seeds=[0], out=tmp_path)
    with pytest.raises(InvalidInputError, match="choose another --out"):
        run_benchmark(benchmark(missions=2), STEADY, seeds=[0], out=tmp_path)
    with pytest.raises(InvalidInputError, match="choose another --out"):
        run_benchmark(benchmark(missions=1), STEADY, settings={"after": 3}, seeds=[0], out=tmp_path)


@pytest.mark.parametrize(
    ("entry", "says"),
    [
        ("no_such_module:Agent", "No module named"),
        ("tests.evaluation.agents:Nobody", "Nobody"),
        ("tests.evaluation.agents:FailsWhenMade", "OSError: no weights here"),
        ("tests.evaluation.agents:NeedsTooMuch", "sensor 'objects' needs track 'privileged'"),
        ("pathlib:Path", "has no spec"),
        ("steady", "module:name"),
    ],
)
def test_an_impossible_agent_is_refused_before_anything_is_written(tmp_path: Path, entry: str, says: str) -> None:
    with pytest.raises(InvalidInputError, match=says):
        run_benchmark(benchmark(), entry, out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_world_that_cannot_be_is_the_users_to_mend(tmp_path: Path) -> None:
    nowhere_to_walk = benchmark(missions=1).model_dump(mode="json")
    nowhere_to_walk["cells"][0]["network"] = str(motorway(tmp_path))
    nowhere_to_walk["missions"]["all"][0] |= {"start": {"lane": "a_0"}, "goal": {"lane": "a_0", "position_m": 90.0}}
    with pytest.raises(InvalidInputError, match="no sidewalk"):
        run_benchmark(Benchmark.model_validate(nowhere_to_walk), STEADY, seeds=[0], out=tmp_path / "out")


def motorway(folder: Path) -> Path:
    """A road without sidewalks."""
    (folder / "m.nod.xml").write_text('<nodes><node id="n" x="0" y="0"/><node id="m" x="200" y="0"/></nodes>')
    edge = '<edge id="a" from="n" to="m" numLanes="2" disallow="pedestrian"/>'
    (folder / "m.edg.xml").write_text(f"<edges>{edge}</edges>")
    net = folder / "m.net.xml"
    netconvert = Path(sumo.SUMO_HOME) / "bin" / "netconvert"
    command = [netconvert, "-n", folder / "m.nod.xml", "-e", folder / "m.edg.xml", "-o", net]
    subprocess.run(command, check=True, capture_output=True)
    return net


def test_a_part_says_so_and_is_completed_with_the_records_of_the_whole(tmp_path: Path) -> None:
    three = benchmark(missions=3, goal_m=10.0)
    part = run_benchmark(three, STEADY, seeds=[0], only=["drive-1"], out=tmp_path)
    assert [record.scenario.name for record in part.records] == ["drive-1"]
    assert read_result(tmp_path).manifest.part == "part of short: 1 of 3 missions"
    assert part_of_record(part.paths[0]) == "part of short: 1 of 3 missions"

    with pytest.raises(InvalidInputError, match="holds part of short: 1 of 3 missions, among them drive-1, which is"):
        run_benchmark(three, STEADY, seeds=[0], only=["drive-0", "drive-2"], out=tmp_path)
    assert len(finished(tmp_path)) == 1  # nothing was driven

    larger = run_benchmark(three, STEADY, seeds=[0], only=["drive-[01]"], out=tmp_path)
    assert (larger.resumed, larger.manifest.part) == (1, "part of short: 2 of 3 missions")

    whole = run_benchmark(three, STEADY, seeds=[0], out=tmp_path)
    assert (whole.resumed, whole.manifest.part) == (2, "")
    assert whole.records[1].record_hash == part.records[0].record_hash
    assert "missions" not in json.loads((tmp_path / "evaluation.json").read_text())
    with pytest.raises(InvalidInputError, match="holds the whole of short, not a part; choose another --out"):
        run_benchmark(three, STEADY, seeds=[0], sample=2, out=tmp_path)


def test_missing_episodes_are_told_and_more_seeds_are_ordered_beside_the_first(tmp_path: Path) -> None:
    two, out = benchmark(goal_m=10.0), tmp_path / "out"
    first = run_benchmark(two, STEADY, seeds=[0, 1], out=out)
    assert (first.part, read_result(out).part, part_of_record(first.paths[0])) == ("", "", "")
    kept = {path: path.read_bytes() for path in first.paths}
    for path in first.paths[1:]:
        path.unlink()
    words = "part of short: 1 of 4 episodes"
    assert (read_result(out).part, part_of_record(first.paths[0])) == (words, words)

    other = run_benchmark(two, STEADY, seeds=[5], out=out)
    assert other.part == "", "all that was ordered now is there"
    assert read_result(out).part == "part of short: 3 of 6 episodes"
    assert json.loads((out / "evaluation.json").read_text())["seeds"] == [0, 1, 5]
    for path, content in kept.items():
        path.write_bytes(content)
    assert read_result(out).part == ""


def test_missing_episodes_of_a_part_are_told_too(tmp_path: Path) -> None:
    three = benchmark(missions=3, goal_m=10.0)
    run_benchmark(three, STEADY, seeds=[0], only=["drive-1"], out=tmp_path)
    run_benchmark(three, STEADY, seeds=[1], only=["drive-[01]"], out=tmp_path)
    assert read_result(tmp_path).part == "part of short: 2 of 3 missions, 3 of 4 episodes"


def test_a_manifest_without_seeds_is_read_by_the_seeds_of_its_records(tmp_path: Path) -> None:
    result = run_benchmark(benchmark(goal_m=10.0), STEADY, seeds=[0, 1], out=tmp_path)
    manifest = json.loads((tmp_path / "evaluation.json").read_text())
    del manifest["seeds"]
    (tmp_path / "evaluation.json").write_text(json.dumps(manifest))
    assert read_result(tmp_path).part == ""
    result.paths[0].unlink()
    assert read_result(tmp_path).part == "part of short: 3 of 4 episodes"
    again = run_benchmark(benchmark(goal_m=10.0), STEADY, seeds=[2], out=tmp_path)
    assert json.loads((tmp_path / "evaluation.json").read_text())["seeds"] == [2]
    assert (again.part, read_result(tmp_path).part) == ("", "part of short: 5 of 6 episodes")


def test_a_sample_of_all_missions_is_the_benchmark(tmp_path: Path) -> None:
    result = run_benchmark(benchmark(missions=1), STEADY, seeds=[0], sample=1, out=tmp_path)
    assert result.manifest.part == ""
