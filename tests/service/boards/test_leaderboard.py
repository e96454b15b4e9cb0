from __future__ import annotations

import csv
import io
import random

import pytest

from dohyo.evaluation.records.specifications import Status
from dohyo.service.boards.leaderboard import COLUMNS, Entry, as_csv, as_document, rank
from dohyo.service.evaluations.scoring import Drive, summary_of
from tests.evaluation.builders import ego, episode
from tests.service.evaluations.test_scoring import drives_of, entry, terms


def drives(scores: list[float], scenarios: int = 0) -> list[Drive]:
    """Drives without an infraction: the route completion is the driving score."""
    return [
        drive
        for number, score in enumerate(scores)
        for drive in drives_of(
            episode(ego(progress_m=10.0 * score), name=f"scenario{scenarios + number}"), f"ep{scenarios + number}"
        )
    ]


def names(entries: list[Entry], metric: str = "driving_score") -> list[tuple[int, str]]:
    return [(row.rank, row.entry.agent) for row in rank(entries, metric)]


def test_the_higher_mean_comes_first_whatever_the_order() -> None:
    entries = [entry("low", drives([10.0] * 8)), entry("high", drives([90.0] * 8)), entry("mid", drives([50.0] * 8))]
    for _ in range(5):
        random.Random(0).shuffle(entries)
        assert names(entries) == [(1, "high"), (2, "mid"), (3, "low")]


def test_each_row_is_tested_against_the_one_above() -> None:
    rows = rank([entry("low", drives([10.0] * 8)), entry("high", drives([30.0] * 8))], "driving_score")
    assert rows[0].above is None
    assert rows[1].above is not None
    assert rows[1].above.verdict == "<"
    assert rows[1].above.probability == 0.0
    assert rows[1].above.difference.mean == pytest.approx(-20.0)
    assert rows[1].above.difference.n == 8


def test_what_cannot_be_told_apart_shares_a_rank() -> None:
    a = entry("a", drives([60.0, 40.0, 60.0, 40.0]))
    b = entry("b", drives([40.0, 59.0, 41.0, 58.0]))
    c = entry("c", drives([1.0, 2.0, 1.0, 2.0]))
    rows = rank([c, b, a], "driving_score")
    assert [(row.rank, row.entry.agent) for row in rows] == [(1, "a"), (1, "b"), (3, "c")]
    assert rows[1].above is not None
    assert rows[1].above.verdict == "="


def test_a_tie_reaches_only_as_far_as_the_best_of_its_rank() -> None:
    # Each is a little worse than the one above on noisy drives, but the last is clearly worse than the first.
    noise = [0.0, 20.0, -20.0, 10.0, -10.0, 5.0]
    first = entry("first", drives([70.0] * 6))
    second = entry("second", drives([68.0 + one for one in noise]))
    third = entry("third", drives([66.0] * 6))
    rows = rank([first, second, third], "driving_score")
    assert [row.above.verdict if row.above else None for row in rows] == [None, "=", "="]
    assert [(row.rank, row.entry.agent) for row in rows] == [(1, "first"), (1, "second"), (3, "third")]


def test_equal_means_come_in_the_order_of_names() -> None:
    assert names([entry("b", drives([50.0] * 3)), entry("a", drives([50.0] * 3))]) == [(1, "a"), (1, "b")]


def test_without_drives_in_common_the_means_decide() -> None:
    rows = rank([entry("a", drives([50.0] * 3)), entry("b", drives([40.0] * 3, scenarios=10))], "driving_score")
    assert [(row.rank, row.above) for row in rows] == [(1, None), (2, None)]


def test_success_has_wilsons_interval() -> None:
    done = [
        drive
        for number in range(10)
        for drive in drives_of(
            episode(ego(status=Status.COMPLETED if number < 8 else Status.TIMED_OUT), name=f"s{number}"), f"ep{number}"
        )
    ]
    score = entry("a", done).scores["success"]
    # Worked out by hand: 8 of 10, z = 1.96.
    assert (score.mean, score.n) == (80.0, 10)
    assert score.low == pytest.approx(49.0, abs=0.1)
    assert score.high == pytest.approx(94.3, abs=0.1)


def test_a_benchmark_may_rank_by_success() -> None:
    reaching = drives_of(episode(ego(status=Status.COMPLETED, progress_m=1000.0, driven_m=1000.0)))
    assert names([entry("slow", drives([99.0])), entry("there", reaching)], "nocrash_success")[0] == (1, "there")


def test_csv_parses_back() -> None:
    rows = rank([entry("=cmd()", drives([50.0, 60.0])), entry('b "x", y', drives([10.0, 20.0]))], "driving_score")
    table = list(csv.DictReader(io.StringIO(as_csv(rows, "driving_score"))))
    assert [line["agent"] for line in table] == ["'=cmd()", 'b "x", y']
    for line, row in zip(table, rows, strict=True):
        document = as_document(row, "driving_score")
        for name in COLUMNS:
            assert float(line[name]) == document["scores"][name]["mean"]
            assert float(line[f"{name}_low"]) == document["scores"][name]["low"]
    assert (table[0]["verdict_above"], table[1]["verdict_above"]) == ("", "<")


def test_an_empty_leaderboard_is_empty() -> None:
    assert rank([], "driving_score") == []


def closed_loop(score: float, progress_m: float) -> Drive:
    """A drive that came so far, with a closed-loop score of so much."""
    (facts,) = summary_of(episode(ego(progress_m=progress_m)), "2.0", {"ego": terms(score / 100.0, 1.0)})["egos"]
    return Drive("ep", "scenario", "cell", 0, facts)


def test_a_closed_loop_benchmark_ranks_by_that_score_alone() -> None:
    far, near = entry("far", [closed_loop(50.0, 900.0)]), entry("near", [closed_loop(75.0, 100.0)])
    rows = rank([far, near], "closed_loop")
    assert [row.entry.agent for row in rows] == ["near", "far"]
    assert [as_document(row, "closed_loop")["scores"]["closed_loop"]["mean"] for row in rows] == [75.0, 50.0]
    assert rank([far, near], "driving_score")[0].entry.agent == "far"
    header = as_csv(rows, "closed_loop").splitlines()[0].split(",")
    assert {"closed_loop", "closed_loop_low", "no_collision", "comfort_high", "driving_score"} <= set(header)
    assert "closed_loop" not in as_document(rows[0], "driving_score")["scores"]
