"""Numba's cache: kernels whose source lies in several files, changed between two processes."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.forked import ROOT, Python

LIMITS = """
from enum import IntEnum
from typing import NamedTuple
import numpy as np
from numba import njit
from numba.extending import register_jitable

WIDTH = 1.0
LENGTH = 1.0
ANGLES = np.array([1.0, 2.0])

class Side(IntEnum):
    LEFT = 1

class Box(NamedTuple):
    x: float
    y: float

def kernel(function):
    return njit(cache=True, error_model="python")(function)

@njit
def widened(x):
    return x + WIDTH

@register_jitable
def doubled(x, times=2.0):
    return x * times
"""

STEPS = """
import dohyo
from numba import njit
from yard.limits import LENGTH, widened

@njit(cache=True)
def twice_widened(x):
    return widened(x) + widened(x)
"""

ROWS = """
import dohyo
from numba import njit
from yard import limits
from yard.limits import ANGLES, LENGTH, Box, Side, doubled, kernel, widened
from yard.steps import twice_widened

UNTOUCHED = 7.0

@njit(cache=True)
def constant(x):
    return x + LENGTH

@njit(cache=True)
def constant_of_a_module(x):
    return x + limits.WIDTH

@njit(cache=True)
def called(x):
    return widened(x)

@njit(cache=True)
def called_indirectly(x):
    return twice_widened(x)

@njit(cache=True)
def called_by_a_function_below(x):
    return below(x)

@njit(cache=True)
def below(x):
    return widened(x)

@njit(cache=True)
def member_of_an_enumeration(x):
    return x + 1.0 if Side.LEFT == 1 else x + 10.0

@njit(cache=True)
def fields_of_a_tuple(x):
    return Box(x, -x).x

@njit(cache=True)
def array(x):
    return x + ANGLES[0]

@njit(cache=True)
def default_of_an_argument(x):
    return doubled(x)

@kernel
def options_of_a_decorator(x):
    return 1.0 / (x - 1.0)

@njit(cache=True)
def untouched(x):
    return x + UNTOUCHED
"""

CHANGES = {
    "WIDTH = 1.0": "WIDTH = 10.0",
    "LENGTH = 1.0": "LENGTH = 10.0",
    "[1.0, 2.0]": "[10.0, 2.0]",
    "LEFT = 1": "LEFT = 10",
    "    x: float\n    y: float": "    y: float\n    x: float",
    "times=2.0": "times=20.0",
    '"python"': '"numpy"',
}

BEFORE = {
    "constant": 2.0,
    "constant_of_a_module": 2.0,
    "called": 2.0,
    "called_indirectly": 4.0,
    "called_by_a_function_below": 2.0,
    "member_of_an_enumeration": 2.0,
    "fields_of_a_tuple": 1.0,
    "array": 2.0,
    "default_of_an_argument": 2.0,
    "options_of_a_decorator": "ZeroDivisionError",
    "untouched": 8.0,
}

AFTER = {
    "constant": 11.0,
    "constant_of_a_module": 11.0,
    "called": 11.0,
    "called_indirectly": 22.0,
    "called_by_a_function_below": 11.0,
    "member_of_an_enumeration": 11.0,
    "fields_of_a_tuple": -1.0,
    "array": 11.0,
    "default_of_an_argument": 20.0,
    "options_of_a_decorator": "inf",
    "untouched": 8.0,
}

CALL = """
import importlib, json, sys

def result(kernel):
    try:
        value = kernel(1.0)
    except ZeroDivisionError:
        return "ZeroDivisionError"
    return "inf" if value == float("inf") else value

module, *names = sys.argv[1:]
kernels = {name: getattr(importlib.import_module(module), name) for name in names}
values = {name: result(kernel) for name, kernel in kernels.items()}
loaded = [name for name, kernel in kernels.items() if kernel.stats.cache_hits]
json.dump([values, loaded], sys.stdout)
"""

DIGESTS = """
import sys, json
import dohyo.agents.parking.expert.expert, dohyo.sumo_networks.parking.world, dohyo.sumo_networks.rendering.overhead
from numba.core.dispatcher import Dispatcher
from dohyo.kernel_cache import digest

json.dump({
    f"{name}.{kernel}": digest(value.py_func)
    for name, module in sys.modules.items() if name.startswith("dohyo.")
    for kernel, value in vars(module).items() if isinstance(value, Dispatcher)
}, sys.stdout)
"""


@pytest.fixture
def yard(tmp_path: Path) -> Path:
    """A package of which one module has kernels, and refers to two others."""
    folder = tmp_path / "yard"
    folder.mkdir()
    for name, text in {"__init__": "", "limits": LIMITS, "steps": STEPS, "rows": ROWS}.items():
        (folder / f"{name}.py").write_text(text)
    return folder


def call(folder: Path, module: str = "yard.rows", names: tuple[str, ...] = tuple(BEFORE)) -> Any:
    """What kernels return in a process of its own, and which of them it found compiled."""
    process = Python(CALL, module, *names, cwd=folder)
    assert process.end() == 0, process.errors()
    return json.loads(process.output())


def interpreter(code: str, *arguments: str, cwd: Path = ROOT, **environment: str) -> Any:
    command = [sys.executable, "-c", code, *arguments]
    done = subprocess.run(command, cwd=cwd, env=os.environ | environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_kernels_are_compiled_again_when_what_they_refer_to_in_other_files_changes(yard: Path) -> None:
    assert call(yard.parent) == [BEFORE, []]
    unrelated = f"# A comment, and what no kernel refers to.\nDEPTH = 3.0\n{LIMITS}"
    (yard / "limits.py").write_text(unrelated)
    assert call(yard.parent) == [BEFORE, list(BEFORE)]
    changed = unrelated
    for old, new in CHANGES.items():
        assert old in changed
        changed = changed.replace(old, new)
    (yard / "limits.py").write_text(changed)
    assert call(yard.parent) == [AFTER, ["untouched"]]


def test_they_are_found_in_whatever_order_numba_and_dohyo_are_imported(yard: Path) -> None:
    """Each process has its own order of sets, too."""
    names = ["called_indirectly", "array"]
    values = {name: BEFORE[name] for name in names}
    for seed, imports, loaded in (("1", "import dohyo, numba", []), ("2", "import numba, dohyo", names)):
        found = interpreter(f"{imports}\n{CALL}", "yard.rows", *names, cwd=yard.parent, PYTHONHASHSEED=seed)
        assert found == [values, loaded]


def test_kernels_of_packages_that_do_not_import_dohyo_are_shared_with_processes_without_it(tmp_path: Path) -> None:
    (tmp_path / "shed.py").write_text("from numba import njit\n@njit(cache=True)\ndef same(x):\n    return x\n")
    assert call(tmp_path, "shed", ("same",)) == [{"same": 1.0}, []]
    assert interpreter(CALL, "shed", "same", cwd=tmp_path) == [{"same": 1.0}, ["same"]]


def test_all_processes_agree_on_what_a_kernel_was_compiled_from() -> None:
    first, second = (interpreter(DIGESTS, PYTHONHASHSEED=seed) for seed in ("1", "2"))
    assert len(first) > 50
    assert first == second
