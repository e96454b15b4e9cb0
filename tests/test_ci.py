"""`.ci/run`: its exit code, and that nothing of it goes on once it is ended; `make` is a stand-in."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[1] / ".ci/run"
PATIENCE_S = 60.0
# It notes its target and its process, and goes on for ever at the target in the file `hang`.
MAKE = """#!/bin/sh
for target; do case "$target" in *=*) ;; *) last=$target;; esac; done
echo "$last $$" >>started
[ "$last" != "$(cat hang)" ] || exec sleep 600
[ "$last" != "$(cat fail)" ] || exit 3
[ "$last" != test ] || ! cat summary 2>/dev/null || exit 2
"""
# Runs the tests that failed once more; it notes so, and they pass unless there is a file `again`.
PYTHON = """#!/bin/sh
echo "again $$" >>started
[ ! -e again ]
"""


@pytest.fixture
def checkout(tmp_path: Path) -> Iterator[Path]:
    """A checkout with the script alone, and with commands that do nothing."""
    (tmp_path / ".ci").mkdir()
    shutil.copy(SCRIPT, tmp_path / ".ci")
    (tmp_path / "bin").mkdir()
    for name in ("make", "chromium", "node", "openssl", "apt-get"):
        command = tmp_path / "bin" / name
        command.write_text(MAKE if name == "make" else "#!/bin/sh\n")
        command.chmod(0o755)
    python = tmp_path / ".venv/bin/python"
    python.parent.mkdir(parents=True)
    python.write_text(PYTHON)
    python.chmod(0o755)
    for name in ("hang", "fail", "started"):
        (tmp_path / name).touch()
    yield tmp_path
    for process in started(tmp_path).values():
        if alive(process):
            os.kill(process, signal.SIGKILL)


def started(checkout: Path) -> dict[str, int]:
    """Process of each target."""
    return {target: int(process) for target, process in map(str.split, (checkout / "started").open())}


def run(checkout: Path) -> subprocess.Popen[bytes]:
    variables = os.environ | {"PATH": f"{checkout / 'bin'}:{os.environ['PATH']}"}
    return subprocess.Popen([checkout / ".ci/run"], cwd=checkout, env=variables)


def alive(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def wait_until_gone(process: int) -> None:
    ends = time.monotonic() + PATIENCE_S
    while alive(process):
        assert time.monotonic() < ends, f"process {process} goes on"
        time.sleep(0.05)


@pytest.mark.parametrize("target", [".venv/.packages", "setup", "docs", "test"])
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_what_ends_it_ends_what_it_started(target: str, number: signal.Signals, checkout: Path) -> None:
    (checkout / "hang").write_text(target)
    with run(checkout) as whole:
        ends = time.monotonic() + PATIENCE_S
        while target not in started(checkout):
            assert time.monotonic() < ends, "it never begins"
            time.sleep(0.05)
        whole.send_signal(number)
        assert whole.wait(PATIENCE_S) != 0
    for process in started(checkout).values():
        wait_until_gone(process)


@pytest.mark.parametrize(("target", "code"), [("", 0), ("setup", 3), ("docs", 3), ("test", 3)])
def test_it_ends_with_the_code_of_what_failed(target: str, code: int, checkout: Path) -> None:
    (checkout / "fail").write_text(target)
    with run(checkout) as whole:
        assert whole.wait(PATIENCE_S) == code
    assert ("test" in started(checkout)) is (target != "setup")


@pytest.mark.parametrize(
    ("counts", "error", "fails_again", "code"),
    [
        ("1 failed, 9000 passed in 60.00s (0:01:00)", 1, False, 0),
        ("9 failed, 9000 passed, 1 error in 60.00s (0:01:00)", 1, True, 2),
        ("10 failed, 9000 passed in 60.00s (0:01:00)", 1, None, 2),
        ("1 failed, 20 passed in 60.00s (0:01:00)", 2, None, 2),  # interrupted: the rest was not run
        ("9000 passed in 60.00s (0:01:00)", 1, None, 2),
    ],
)
def test_a_few_failures_are_run_again_alone(
    counts: str, error: int, fails_again: bool | None, code: int, checkout: Path
) -> None:
    (checkout / "summary").write_text(f"{counts}\nmake: *** [Makefile:32: test] Error {error}\n")
    if fails_again:
        (checkout / "again").touch()
    with run(checkout) as whole:
        assert whole.wait(PATIENCE_S) == code
    assert ("again" in started(checkout)) is (fails_again is not None)
