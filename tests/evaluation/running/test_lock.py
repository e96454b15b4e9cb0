"""A folder is one process's at a time, and free again however that process ends."""

from __future__ import annotations

import errno
import os
import signal
from pathlib import Path

import pytest
from filelock import FileLock

from dohyo.evaluation.running.lock import held
from dohyo.sumo_networks.errors import InvalidInputError
from tests.forked import Python

HOLDS = "import sys, time; from pathlib import Path; from dohyo.evaluation.running.lock import held\n"
HOLDS += "with held(Path(sys.argv[1])):\n"
HOLDS += "    print('held', flush=True); time.sleep(60)"


def test_a_folder_is_made_and_free_again_after_the_block(tmp_path: Path) -> None:
    for _ in range(2):
        with held(tmp_path / "a" / "b"):
            assert (tmp_path / "a" / "b").is_dir()


def test_another_process_is_kept_out_until_the_first_is_killed(tmp_path: Path) -> None:
    other = Python(HOLDS, str(tmp_path))
    other.wait_for(lambda: other.output() == "held\n")
    with (
        pytest.raises(InvalidInputError, match=r"study '.*' is in use by another process: wait until it ends"),
        held(tmp_path, "study"),
    ):
        pytest.fail("both hold it")
    other.end(signal.SIGKILL)
    with held(tmp_path):
        pass


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / ".lock").mkdir()
    with pytest.raises(InvalidInputError, match="cannot be used"), held(tmp_path):
        pytest.fail("held")


def test_a_file_in_its_place_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with (
        pytest.raises(InvalidInputError, match="cannot be used: File exists"),
        held(tmp_path / "file"),
    ):
        pytest.fail("held")


def test_the_same_process_cannot_hold_it_twice(tmp_path: Path) -> None:
    with held(tmp_path), pytest.raises(InvalidInputError, match="is in use"), held(tmp_path):
        pytest.fail("held twice")


def test_where_nobody_may_write_it_goes_on_without_a_lock_if_reading_will_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(lock: FileLock) -> None:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    monkeypatch.setattr(FileLock, "acquire", refuse)
    with held(tmp_path, read_only=True):
        pass
    with pytest.raises(InvalidInputError, match="cannot be used: Read-only file system"), held(tmp_path):
        pytest.fail("held")
