"""Outputs that cannot be written, and files that cannot be used: one line and exit code 2."""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from dohyo.evaluation.output_file import write_output
from dohyo.service.cli import main
from dohyo.sumo_networks.errors import InvalidInputError

Call = Callable[..., tuple[int, str]]


@pytest.fixture
def call(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Call:
    """Calls a command; returns its exit code and what it printed on standard error."""

    def called(*arguments: object) -> tuple[int, str]:
        monkeypatch.setattr(sys, "argv", ["dohyo", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        return int(ended.value.code or 0), capsys.readouterr().err

    return called


def test_an_output_is_written_whole(tmp_path: Path) -> None:
    write_output(tmp_path / "page.html", b"<html>")
    assert (tmp_path / "page.html").read_bytes() == b"<html>"


@pytest.mark.parametrize(
    ("path", "says"),
    [
        (".", "cannot write '.': expected a file, got a folder"),
        ("{folder}", "cannot write '{folder}': expected a file, got a folder"),
        ("{folder}/file/page.html", "cannot write '{folder}/file/page.html': Not a directory"),
    ],
)
def test_an_impossible_output_is_refused_by_its_name(path: str, says: str, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InvalidInputError) as refused:
        write_output(Path(path.format(folder=tmp_path)), b"<html>")
    assert str(refused.value) == says.format(folder=tmp_path)


def test_explain_refuses_a_folder_before_it_drives(call: Call, tmp_path: Path) -> None:
    code, errors = call("explain", "no-record.json", "--time", 1, "--out", tmp_path)
    assert (code, errors) == (2, f"dohyo: cannot write '{tmp_path}': expected a file, got a folder\n")


def test_forecasts_below_a_file_are_refused(call: Call, tmp_path: Path) -> None:
    table, out = tmp_path / "table.csv", tmp_path / "table.csv" / "out.csv"
    rows = [f"2024-03-04 {5 + row // 12:02d}:{row % 12 * 5:02d}:00,{20 + row % 3}" for row in range(60)]
    table.write_text("\n".join(["timestamp,value", *rows, ""]))
    code, errors = call("forecast", "run", "--data", table, "--model", "persistence", "--out", out)
    assert (code, errors.startswith(f"dohyo: cannot write '{out}': ")) == (2, True), errors
    assert len(errors.splitlines()) == 1


def raising(error: OSError) -> Callable[[], None]:
    def app() -> None:
        raise error

    return app


@pytest.mark.parametrize(
    ("error", "says"),
    [
        (OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)), "cannot write: No space left on device"),
        (OSError(errno.EROFS, os.strerror(errno.EROFS), "a.csv"), "cannot write 'a.csv': Read-only file system"),
        (PermissionError(errno.EACCES, os.strerror(errno.EACCES), "a.csv"), "cannot use 'a.csv': Permission denied"),
        (OSError(errno.EISDIR, os.strerror(errno.EISDIR), ".draft", None, "a"), "cannot use 'a': Is a directory"),
    ],
)
def test_any_other_file_that_cannot_be_used_is_one_line(
    error: OSError, says: str, call: Call, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.modules["dohyo.service.cli.main"], "app", raising(error))
    assert call() == (2, f"dohyo: {says}\n")


@pytest.mark.parametrize("error", [BrokenPipeError(errno.EPIPE, "Broken pipe"), ConnectionRefusedError(111, "Refused")])
def test_an_error_about_no_file_is_raised(error: OSError, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.modules["dohyo.service.cli.main"], "app", raising(error))
    with pytest.raises(type(error)):
        main()
