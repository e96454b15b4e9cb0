"""The runner: a durable row per cell, whatever dies, and the same call runs what is missing."""

from __future__ import annotations

import json
import os
import signal
import time
from functools import partial
from pathlib import Path

import pytest

from dohyo.agents.studies import runner
from dohyo.agents.studies.arms import Block, Cell, Place, cells_of
from dohyo.agents.studies.rows import cell_of, matched, read_rows
from dohyo.agents.studies.runner import DIED, NOTHING, row_each, run
from dohyo.agents.studies.trained import TrainedOptions
from dohyo.evaluation.running.lock import held
from dohyo.sumo_networks.errors import InvalidInputError, SimulationError
from tests.forked import Python

CELLS = cells_of([Block(("a", "b"), (0, 1), [Place("town", f"m{i}", 7) for i in range(3)])])
SLOW = """
import sys, time
from pathlib import Path
from tests.agents.studies.test_runner import CELLS, measured
from dohyo.agents.studies.runner import run

def work(job):
    if job[0] == CELLS[3]:
        time.sleep(600)  # until it is killed
    return measured(job)

run(Path(sys.argv[1]), CELLS, work)
"""


def measured(job):
    """The scenario's number for arm a, one more for arm b."""
    for cell in job:
        yield {**cell._asdict(), "score": int(cell.scenario[1:]) + (cell.arm == "b")}


def counted(job, log: Path):
    """Writes what it does into a file."""
    with log.open("a") as file:
        file.writelines(f"{cell.arm} {cell.training_seed} {cell.scenario}\n" for cell in job)
    yield from measured(job)


def failing(job):
    """Loses the first scenario of arm a, and ends the process in the second one of arm b."""
    for cell in job:
        if (cell.arm, cell.scenario) == ("a", "m0"):
            raise SimulationError("SUMO is gone")
        if (cell.arm, cell.scenario, cell.training_seed) == ("b", "m1", 0):
            os._exit(3)
    yield from measured(job)


def failing_halfway(job, error):
    """The first two rows of a job, then an error."""
    for number, row in enumerate(measured(job)):
        if number == 2:
            raise error
        yield row


def refused(job):
    raise InvalidInputError("no such training")


def silent(job):
    return []


def until(true) -> None:
    """Waits for what another process does."""
    end = time.monotonic() + 60.0
    while not true():
        assert time.monotonic() < end
        time.sleep(0.02)


def test_cells_are_the_product_of_each_block_once():
    assert len(CELLS) == 2 * 2 * 3
    assert CELLS[0] == Cell("a", 0, "town", "m0", 7)
    places = [Place("town", "m0", 7)]
    assert cells_of([Block(("a",), (0,), places), Block(("a", "b"), (0, 1), places)]) == [
        Cell("a", 0, "town", "m0", 7), Cell("a", 1, "town", "m0", 7), Cell("b", 0, "town", "m0", 7),
        Cell("b", 1, "town", "m0", 7),
    ]  # fmt: skip


def test_every_cell_has_a_row_and_a_second_call_runs_only_what_is_missing(tmp_path):
    log, path = tmp_path / "log", tmp_path / "out" / "rows.jsonl"
    work = partial(counted, log=log)
    run(path, CELLS[:5], work)
    run(path, CELLS, work)
    assert [cell_of(row) for row in read_rows(path)] == CELLS
    assert len(log.read_text().splitlines()) == len(CELLS)
    assert matched(read_rows(path), "b", "score")["town", "m2", 7] == {0: 3.0, 1: 3.0}


def test_processes_give_the_rows_of_one(tmp_path):
    run(tmp_path / "one" / "rows.jsonl", CELLS, measured)
    run(
        tmp_path / "two" / "rows.jsonl",
        CELLS,
        measured,
        workers=2,
        together=lambda cell: (cell.arm, cell.training_seed),
    )
    one, two = (read_rows(tmp_path / name / "rows.jsonl") for name in ("one", "two"))
    assert sorted(one, key=cell_of) == sorted(two, key=cell_of)


def test_a_lost_cell_is_a_row_that_says_so_is_in_no_mean_and_is_run_again(tmp_path):
    path = tmp_path / "rows.jsonl"
    run(path, CELLS, failing, workers=2)
    lost = {cell_of(row)[:4]: row["lost"] for row in read_rows(path) if "lost" in row}
    assert lost == {
        ("a", 0, "town", "m0"): "SimulationError: SUMO is gone",
        ("a", 1, "town", "m0"): "SimulationError: SUMO is gone",
        ("b", 0, "town", "m1"): DIED,
    }
    assert len(read_rows(path)) == len(CELLS)
    assert matched(read_rows(path), "b", "score")["town", "m1", 7] == {1: 2.0}
    run(path, CELLS, measured)
    assert sorted(cell_of(row) for row in read_rows(path)) == sorted(CELLS)
    assert not [row for row in read_rows(path) if "lost" in row]


@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.parametrize("error", [SimulationError("SUMO is gone"), ZeroDivisionError("SUMO is gone")])
def test_rows_from_before_an_error_stay_and_only_the_other_cells_are_lost(tmp_path, workers, error):
    path, log = tmp_path / "rows.jsonl", tmp_path / "log"
    run(path, CELLS, partial(failing_halfway, error=error), workers=workers, together=arm_and_seed)
    said = f"{type(error).__name__}: SUMO is gone"
    assert {(row["scenario"], row.get("lost")) for row in read_rows(path)} == {("m0", None), ("m1", None), ("m2", said)}
    assert sorted(cell_of(row) for row in read_rows(path)) == sorted(CELLS)
    run(path, CELLS, partial(counted, log=log), together=arm_and_seed)
    assert log.read_text().split()[2::3] == ["m2"] * 4
    assert [row["score"] for row in read_rows(path) if cell_of(row)[:2] == ("b", 1)] == [1, 2, 3]


def test_a_cell_whose_simulation_fails_alone_is_a_lost_row_and_the_next_ones_are_measured(tmp_path):
    def measure(cell):
        if cell.scenario == "m1":
            raise SimulationError("SUMO is gone")
        return next(measured([cell]))

    cells = [cell for cell in CELLS if cell[:2] == ("a", 0)]
    run(tmp_path / "rows.jsonl", cells, partial(row_each, measure=measure), together=arm_and_seed)
    first, lost, last = read_rows(tmp_path / "rows.jsonl")
    assert lost == {**cells[1]._asdict(), "lost": "SimulationError: SUMO is gone"}
    assert [first["score"], last["score"]] == [0, 2]


def test_a_cell_for_which_the_work_has_no_row_is_lost(tmp_path):
    run(tmp_path / "rows.jsonl", CELLS[:1], silent)
    assert [row["lost"] for row in read_rows(tmp_path / "rows.jsonl")] == [NOTHING]


def test_an_error_of_the_input_stops_the_study_and_keeps_the_rows(tmp_path):
    path = tmp_path / "rows.jsonl"
    run(path, CELLS[:2], measured)
    for workers in (1, 2):
        with pytest.raises(InvalidInputError, match="no such training"):
            run(path, CELLS, refused, workers=workers)
    assert [cell_of(row) for row in read_rows(path)] == CELLS[:2]


def arm_and_seed(cell):
    return (f"{cell.arm}/seed-{cell.training_seed}",)


def trained_beside_another(job, runs: Path):
    """Trains the arm of a job, unless that is done; a training goes on until another one has begun, or is done."""

    def train(folder: Path) -> None:
        if (folder / "best.onnx").exists():
            return  # as a training that is done: jobs that only read it do not exclude each other
        with held(folder):
            with (runs / "log").open("a") as file:
                file.write(f"{folder.relative_to(runs)}\n")
            until(lambda: len(list(runs.glob("*/*"))) > 1)
            time.sleep(0.2)
            (folder / "best.onnx").touch()

    TrainedOptions(runs=runs).trained(*arm_and_seed(job[0]), train)
    yield from measured(job)


def test_jobs_of_one_training_wait_for_it_while_another_one_begins(tmp_path):
    cells = cells_of([Block(("a", "b"), (0,), [Place("town", f"m{i}", 7) for i in range(3)])])
    cells.sort(key=lambda cell: cell.arm)
    work = partial(trained_beside_another, runs=tmp_path / "runs")
    (tmp_path / "runs").mkdir()
    run(tmp_path / "rows.jsonl", cells, work, workers=2, trainings=arm_and_seed)
    assert sorted(cell_of(row) for row in read_rows(tmp_path / "rows.jsonl") if "score" in row) == sorted(cells)
    assert sorted((tmp_path / "runs" / "log").read_text().split()) == ["a/seed-0", "b/seed-0"]


def failing_once(job, runs: Path):
    """Trains, where the first training is lost."""

    def train(folder: Path) -> None:
        with held(folder):
            time.sleep(0.2)
            if not (folder / "failed").exists():
                (folder / "failed").touch()
                raise SimulationError("SUMO is gone")
            (folder / "best.onnx").touch()

    TrainedOptions(runs=runs).trained(*arm_and_seed(job[0]), train)
    yield from measured(job)


def test_a_training_that_was_lost_is_tried_by_one_job_after_the_other(tmp_path):
    cells = CELLS[:1] + [cell for cell in CELLS[1:] if cell[:2] == CELLS[0][:2]]
    work = partial(failing_once, runs=tmp_path / "runs")
    run(tmp_path / "rows.jsonl", cells, work, workers=2, trainings=arm_and_seed)
    assert [row.get("lost") for row in read_rows(tmp_path / "rows.jsonl")] == [
        "SimulationError: SUMO is gone",
        None,
        None,
    ]


def refused_beside_another(job, folder: Path):
    """Refuses arm b, as soon as a job of arm a has begun; that one ends once the runner knows of the error."""
    if job[0].arm == "b":
        until((folder / "begun").exists)
        raise InvalidInputError("no such training")
    (folder / "begun").touch()
    until((folder / "known").exists)
    yield from measured(job)


def test_the_job_beside_an_error_of_the_input_keeps_its_rows(tmp_path, monkeypatch):
    wait = runner.wait

    def watched(going, **options):
        found = wait(going, **options)
        if any(one.exception() for one in found.done):
            (tmp_path / "known").touch()
        return found

    monkeypatch.setattr(runner, "wait", watched)
    path, cells = tmp_path / "rows.jsonl", [CELLS[0], Cell("b", 0, "town", "m0", 7), *CELLS[1:3]]
    with pytest.raises(InvalidInputError, match="no such training"):
        run(path, cells, partial(refused_beside_another, folder=tmp_path), workers=2)
    assert [cell_of(row) for row in read_rows(path)] == CELLS[:1]


def test_rows_of_a_killed_process_stay_and_the_same_call_adds_the_missing_ones(tmp_path):
    path = tmp_path / "rows.jsonl"
    going = Python(SLOW, str(path))
    going.wait_for(lambda: path.exists() and len(path.read_text().splitlines()) >= 2)
    going.end(signal.SIGKILL)
    before = read_rows(path)
    assert 2 <= len(before) < len(CELLS)
    with path.open("a") as file:
        file.write('{"arm": "torn')
    run(path, CELLS, measured)
    assert [cell_of(row) for row in read_rows(path)] == CELLS
    assert read_rows(path)[: len(before)] == before
    assert all(json.loads(line) for line in path.read_text().splitlines())


def test_progress_counts_what_was_there_and_what_was_run(tmp_path):
    seen = []
    run(tmp_path / "rows.jsonl", CELLS[:2], measured)
    run(tmp_path / "rows.jsonl", CELLS[:4], measured, progress=lambda *what: seen.append(what[:2]))
    assert seen == [(3, 4), (4, 4)]


def test_a_row_without_a_cell_is_named(tmp_path):
    (tmp_path / "rows.jsonl").write_text('{"arm": "a", "score": 3}\n')
    with pytest.raises(InvalidInputError, match="expected rows with training_seed, benchmark, scenario, seed"):
        read_rows(tmp_path)
