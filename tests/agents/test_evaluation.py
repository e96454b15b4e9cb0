"""evaluate: every way to name an agent gives the same record."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
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
    assert not list(tmp_path.iterdir())


WHOLE = "expected a seed, a whole number from 0 to 2147483647, got"


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"workers": 0}, "^workers: expected at least 1, a whole number, got 0"),
        ({"workers": "2"}, "^workers: expected at least 1, a whole number, got '2'"),
        ({"workers": 1.5}, "^workers: expected at least 1, a whole number, got 1.5"),
        ({"workers": True}, "^workers: expected at least 1, a whole number, got True"),
        ({"sample": 0}, "^sample: expected at least 1, a whole number, got 0"),
        ({"sample": "1"}, "^sample: expected at least 1, a whole number, got '1'"),
        ({"sample": 2}, "^sample: expected 1 to 1 missions, got 2"),
        ({"only": "left-to-south"}, "^only: expected a list of names or patterns of cells and missions, got 'left-to"),
        ({"only": 3}, "^only: expected a list of names"),
        ({"only": [3]}, r"^only: expected a list of names or patterns of cells and missions, got \[3\]"),
        ({"seeds": 3}, "^seeds: expected a list of seeds, got 3"),
        ({"seeds": "12"}, "^seeds: expected a list of seeds, got '12'"),
        ({"seeds": ["0"]}, f"^seeds: {WHOLE} '0'"),
        ({"seeds": [1.5]}, f"^seeds: {WHOLE} 1.5"),
        ({"seeds": [0, True]}, f"^seeds: {WHOLE} True"),
        ({"seeds": []}, "^seeds: expected at least one, got none"),
        ({"seeds": [2, 2]}, "expected every seed once, got 2 again"),
        ({"benchmark": 5}, "^benchmark: expected a name, the path of a .toml file or a Benchmark, got int"),
        ({"benchmark": tiny().scenarios([0])[0]}, "^benchmark: expected .* or a Benchmark, got Scenario"),
    ],
)
def test_arguments_of_another_form_are_refused_before_anything_is_written(
    options: dict[str, Any], says: str, tmp_path: Path
) -> None:
    with pytest.raises(InvalidInputError, match=says):
        dohyo.evaluate("reckless", **{"benchmark": tiny(), "out": tmp_path / "out"} | options)
    assert not list(tmp_path.iterdir())


def test_seeds_may_be_numpys_or_come_one_by_one(tmp_path: Path) -> None:
    first = dohyo.evaluate("reckless", tiny(), seeds=np.arange(4, 5), out=tmp_path)
    again = dohyo.evaluate("reckless", tiny(), seeds=(seed for seed in [4]), out=tmp_path)
    assert [record.scenario.seed for record in first.records] == [4]
    assert again.resumed == 1
