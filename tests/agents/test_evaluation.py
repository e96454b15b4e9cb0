"""evaluate: every way to name an agent gives the same record."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import dohyo
from dohyo.agents.experts.reckless import Reckless
from dohyo.evaluation.benchmarks.benchmark import Benchmark, load_benchmark
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.scenario import Traffic


def tiny() -> Benchmark:
    """One short drive."""
    whole = load_benchmark("quickstart")
    mission = whole.missions["all"][0]
    traffic = Traffic(vehicles=4, warm_up_s=2.0)
    cell = whole.cells[0].model_copy(update={"traffic": traffic})
    return whole.model_copy(update={"missions": {"all": (mission,)}, "cells": (cell,), "duration_s": 2.0})


def test_a_name_a_path_and_a_class_give_the_same_record(tmp_path: Path) -> None:
    agents = ("reckless", "dohyo.agents.experts.reckless:Reckless", Reckless)
    results = [dohyo.evaluate(agent, tiny(), seeds=[4], out=tmp_path / str(i)) for i, agent in enumerate(agents)]
    hashes = {record.record_hash for result in results for record in result.records}
    assert len(hashes) == 1
    assert [len(result.records) for result in results] == [1, 1, 1]
    assert all(path.is_file() for result in results for path in result.paths)


def test_the_same_call_again_does_only_what_is_missing(tmp_path: Path) -> None:
    dohyo.evaluate("reckless", tiny(), seeds=[4], out=tmp_path)
    assert dohyo.evaluate("reckless", tiny(), seeds=[4], out=str(tmp_path)).resumed == 1


@pytest.mark.parametrize("standard_input", [False, True])
def test_a_script_without_a_guard_is_told_so(standard_input: bool, tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        'import dohyo; dohyo.evaluate("reckless", "quickstart", seeds=[0], only=["through-east"], out="out")'
    )
    told = subprocess.run(
        [sys.executable, "-" if standard_input else str(script)],
        cwd=tmp_path, env={**os.environ, "PYTHONPATH": os.getcwd()}, capture_output=True, text=True,
        input=script.read_text() if standard_input else "", check=False,
    )  # fmt: skip
    assert told.returncode == 1
    last = told.stderr.splitlines()[-1]
    assert ("expected a script in a file" if standard_input else "if __name__") in last, told.stderr
    assert not list(tmp_path.glob("out/records/*"))


def test_what_cannot_be_evaluated_is_refused(tmp_path: Path) -> None:
    class Local(Reckless):
        pass

    with pytest.raises(InvalidInputError, match="at the top of a module"):
        dohyo.evaluate(Local, tiny(), out=tmp_path)
    with pytest.raises(InvalidInputError, match="did you mean 'reckless'"):
        dohyo.evaluate("wreckless", tiny(), out=tmp_path)
    with pytest.raises(InvalidInputError, match="workers: expected at least 1"):
        dohyo.evaluate("reckless", tiny(), out=tmp_path, workers=0)
    assert not list(tmp_path.iterdir())
