"""Tables of the command line, from hand-made summaries."""

from __future__ import annotations

import io
import json

import pytest
from rich.text import Text

from dohyo.evaluation.records.specifications import Status
from dohyo.evaluation.scores.nuplan.score import ClosedLoop
from dohyo.evaluation.scores.nuplan.summary import ScoredDrive, summarise_closed_loop
from dohyo.evaluation.summary import summarise
from dohyo.service.cli.closed_loop import print_closed_loop
from dohyo.service.cli.main import main
from dohyo.service.cli.output import console, number, print_cells, print_comparison, print_rows
from tests.evaluation.builders import ego, episode, lost

WHOLE = [episode(ego(status=Status.PERFECT, progress_m=1000.0), seed=0)]


def test_a_comparison_shows_both_means_only_where_a_drive_was_lost() -> None:
    with console.capture() as captured:
        print_comparison([summarise(WHOLE)])
    assert "counting lost drives as 0" not in captured.get()
    with console.capture() as captured:
        print_comparison([summarise([*WHOLE, lost(seed=1)])])
    above, below = captured.get().split("counting lost drives as 0")
    assert "100" in above.split("DS ")[1].splitlines()[0]
    assert "50.0" in below.split("DS ")[1].splitlines()[0]


def test_cells_say_how_many_drives_they_lost() -> None:
    cells = {"a": summarise(WHOLE), "b": summarise([*WHOLE, lost(seed=1)])}
    with console.capture() as captured:
        print_cells(cells)
    header, first, second = captured.get().splitlines()
    assert header.split()[-1] == "lost"
    assert (first.split()[-1], second.split()[-1]) == ("0", "1")


def test_the_closed_loop_score_too() -> None:
    good = ScoredDrive("s", 0, "ego", "turn", ClosedLoop(1, 1, 1, 1, 1, 1, 1, 1))
    with console.capture() as captured:
        print_closed_loop({"tester": summarise_closed_loop([good], lost=3)}, "agent")
    assert "counting lost drives as 0: 25.0" in " ".join(captured.get().split())


def test_a_strangers_text_is_shown_and_not_obeyed() -> None:
    with console.capture() as captured:
        print_rows(["name"], [("[/b]\x1b[2J[link=http://x]y",)])
        console.print("\x9b2Jone\ntwo [bold]three")
    shown = captured.get()
    assert "[/b]\N{REPLACEMENT CHARACTER}[2J[link=http://x]y" in shown
    assert "2Jone\ntwo [bold]three" in shown
    assert not {"\x1b", "\x9b"} & set(shown)


def test_a_table_for_programs_has_a_line_for_each_row(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)
    name, told = "driver-of-the-whole-fleet", "word " * 60
    with console.capture() as captured:
        print_rows(["name", "control", "description"], [(name, "acceleration_steering", told)] * 2)
    header, *lines = captured.get().splitlines()
    assert header.split() == ["name", "control", "description"]
    assert [line.split()[:2] for line in lines] == [[name, "acceleration_steering"]] * 2
    assert all(line.count("word") == 60 for line in lines)


@pytest.mark.parametrize("terminal", [True, False])
def test_a_line_of_text_stays_one_line(monkeypatch: pytest.MonkeyPatch, terminal: bool) -> None:
    monkeypatch.setattr(console, "_force_terminal", terminal)
    monkeypatch.setattr(console, "_width", 40)
    line = "report: /home/someone/results of a long campaign/autopilot/quickstart/report.html"
    with console.capture() as captured:
        console.print(line)
    assert Text.from_ansi(captured.get()).plain.rstrip() == line


@pytest.mark.parametrize(("width", "whole"), [(80, True), (30, False)])
def test_a_terminal_wraps_what_is_read_and_not_what_is_copied(
    monkeypatch: pytest.MonkeyPatch, width: int, whole: bool
) -> None:
    monkeypatch.setattr(console, "_force_terminal", True)
    monkeypatch.setattr(console, "_width", width)
    monkeypatch.setenv("TERM", "xterm")  # rich takes a dumb one as 80 wide
    row = ("driver-of-the-whole-fleet", "acceleration_steering", "route, objects, lanes and_all_that_is_around_it " * 3)
    with console.capture() as captured:
        print_rows(["name", "control", "sensors"], [row])
    lines = Text.from_ansi(captured.get()).plain.splitlines()
    assert all(len(line.rstrip()) <= width for line in lines)
    assert (row[0] in lines[1] and row[1] in lines[1]) == whole


def _printed(monkeypatch: pytest.MonkeyPatch, encoding: str, *arguments: str) -> str:
    out = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
    monkeypatch.setattr("sys.stdout", out)
    monkeypatch.setattr("sys.argv", ["dohyo", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    assert not ended.value.code
    out.flush()
    return out.buffer.getvalue().decode(encoding)  # type: ignore[attr-defined, no-any-return]


@pytest.mark.parametrize(
    ("value", "shown"),
    [(0.0, "0"), (0.00123, "0.00123"), (-0.0001, "-0.0001"), (0.5, "0.50"), (12.34, "12.3"), (123.4, "123")],
)
def test_a_small_rate_is_not_shown_as_none(value: float, shown: str) -> None:
    assert number(value) == shown


def test_what_an_output_cannot_encode_is_escaped(monkeypatch: pytest.MonkeyPatch) -> None:
    """A pipe in ASCII is no reason for a traceback."""
    assert "K\\xf6nigs" in _printed(monkeypatch, "ascii", "networks", "list")
    assert "Königs" in _printed(monkeypatch, "utf-8", "networks", "list")


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "utf-8"])
def test_json_is_json_in_every_encoding(monkeypatch: pytest.MonkeyPatch, encoding: str) -> None:
    assert "Königs" in str(json.loads(_printed(monkeypatch, encoding, "networks", "list", "--json")))
