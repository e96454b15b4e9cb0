"""Tests in copies of one process, seen from runs of pytest: what passes, fails, warns and dies."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
RUN = """
import signal, sys
import pytest

signal.signal(signal.SIGINT, signal.default_int_handler)  # it is ignored behind a shell's "&"
sys.exit(pytest.main(sys.argv[1:]))
"""
LIVELY = """
import os
import pytest

@pytest.fixture(scope="module")
def shared(tmp_path_factory):
    yield tmp_path_factory.mktemp("shared")
    print("torn down")

@pytest.mark.parametrize("number", range(3))
def test_shared(shared, number, tmp_path):
    (shared / f"{number}-{os.getpid()}").touch()
    assert len(list(shared.iterdir())) == number + 1
    assert len({path.name.split("-")[1] for path in shared.iterdir()}) == 1
    assert not list(tmp_path.iterdir())
    (tmp_path / "mine").touch()
"""
UNLIKE = """
import sys, warnings
import pytest

def test_passes():
    print("nobody reads this")

def test_fails():
    print("on stdout")
    print("on stderr", file=sys.stderr)
    a, b = [1, 2], [1, 3]
    assert a == b

def test_warns():
    warnings.warn("beware of the test", UserWarning)

@pytest.mark.skip(reason="no need")
def test_skipped(): ...

@pytest.mark.xfail
def test_known(): assert False

@pytest.fixture
def broken():
    raise ValueError("in the fixture")

def test_errors(broken): ...
"""
DEADLY = """
import os, signal

def test_before(): ...

def test_dies():
    os.kill(os.getpid(), signal.SIGKILL)

def test_after(): ...
"""
SLOW = """
import time
from pathlib import Path
import pytest

@pytest.fixture
def held():
    yield
    Path("ended").touch()

def test_long(held):
    Path("begun").touch()
    time.sleep(600)
"""


def started(folder: Path, *options: str, **files: str) -> subprocess.Popen[str]:
    for name, content in files.items():
        (folder / f"test_{name}.py").write_text(content)
    command = [sys.executable, "-c", RUN, "-q", "-rA", "-p", "tests.side_by_side", "-p", "no:cacheprovider"]
    environment = os.environ | {"PYTHONPATH": str(ROOT), "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    return subprocess.Popen([*command, *options], cwd=folder, env=environment, **pipes)  # type: ignore[call-overload, no-any-return]


def output(folder: Path, *options: str, **files: str) -> str:
    said, _ = started(folder, *options, **files).communicate(timeout=300)
    return str(said)


@pytest.mark.parametrize("processes", ["1", "3"])
def test_results_are_those_of_one_process(processes: str, tmp_path: Path) -> None:
    many = {f"lively_{number}": LIVELY for number in range(4)}
    said = output(tmp_path, "--processes", processes, unlike=UNLIKE, **many)
    last = said.splitlines()[-1]
    assert "1 failed, 14 passed, 1 skipped, 1 xfailed, 1 warning, 1 error" in last, said
    assert "assert [1, 2] == [1, 3]" in said
    assert "At index 1 diff: 2 != 3" in said
    assert said.count("on stdout\n") == said.count("on stderr\n") == 1
    assert "beware of the test" in said
    assert "ValueError: in the fixture" in said


def test_a_process_that_dies_fails_its_test_and_no_other(tmp_path: Path) -> None:
    said = output(tmp_path, "--processes", "2", deadly=DEADLY, lively=LIVELY)
    assert "1 failed, 5 passed" in said.splitlines()[-1], said
    assert "test_deadly.py::test_dies - its process ended with -9" in said


def test_the_first_failure_ends_it_where_that_is_asked_for(tmp_path: Path) -> None:
    """And not the long test, for which `output` does not wait."""
    said = output(tmp_path, "--processes", "2", "-x", slow=SLOW, unlike=UNLIKE)
    assert "stopping after 1 failures" in said
    assert (tmp_path / "ended").exists() or not (tmp_path / "begun").exists()


SECOND_COPY_LATE = """
import os, pathlib, time

fork = os.fork

def late():
    while not pathlib.Path("begun").exists():
        time.sleep(0.01)
    time.sleep(2)
    return fork()

def first():
    os.fork = late
    return fork()

os.fork = first
"""


@pytest.mark.parametrize("conftest", ["", SECOND_COPY_LATE], ids=["all", "while they are started"])
def test_an_interrupt_ends_what_has_begun(conftest: str, tmp_path: Path) -> None:
    (tmp_path / "conftest.py").write_text(conftest)
    run = started(tmp_path, "--processes", "2", slow=SLOW, slower=SLOW)
    while not (tmp_path / "begun").exists():
        assert run.poll() is None
        time.sleep(0.05)
    run.send_signal(signal.SIGINT)
    said, _ = run.communicate(timeout=300)
    assert run.returncode == pytest.ExitCode.INTERRUPTED, said
    assert (tmp_path / "ended").exists()
