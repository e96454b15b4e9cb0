from __future__ import annotations

import csv
import dataclasses
import gc
import io
import random
import weakref
from typing import Any

import numpy as np
import pytest

from dohyo.evaluation.families import Family
from dohyo.evaluation.records.specifications import Status
from dohyo.service.boards import board
from dohyo.service.boards.board import compare_places
from dohyo.service.boards.leaderboard import COLUMNS, Contender, Entry, Ranks, as_csv, places_of
from dohyo.service.boards.results import facts_of
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


def contenders(entries: list[Entry], metric: str = "driving_score") -> list[Contender]:
    """Complete runs, ordered one after the other."""
    return [
        Contender(
            evaluation=one.evaluation,
            entrant=one.submission,
            baseline=False,
            track=one.track,
            score=one.scores[metric].mean or 0.0,
            number=number,
            dohyo_versions=one.dohyo_versions,
            values=np.array(facts_of(one, metric)["values"], dtype=np.float64),
        )
        for number, one in enumerate(entries)
    ]


def ranked(entries: list[Entry], metric: str = "driving_score") -> list[tuple[int | None, str]]:
    places = Ranks().rank(places_of(contenders(entries, metric)))
    return [(place.rank, place.contender.evaluation.removeprefix("ev-")) for place in places]


def test_the_higher_mean_comes_first_whatever_the_order() -> None:
    entries = [entry("low", drives([10.0] * 8)), entry("high", drives([90.0] * 8)), entry("mid", drives([50.0] * 8))]
    for _ in range(5):
        random.Random(0).shuffle(entries)
        assert ranked(entries) == [(1, "high"), (2, "mid"), (3, "low")]


def test_a_row_is_compared_with_the_one_above() -> None:
    high, low = contenders([entry("high", drives([30.0] * 8)), entry("low", drives([10.0] * 8))])
    above = compare_places(low, high)
    assert above is not None
    assert (above["verdict"], above["probability"]) == ("<", 0.0)
    assert (above["difference"]["mean"], above["difference"]["n"]) == (pytest.approx(-20.0), 8)


def test_a_comparison_is_kept_as_long_as_its_run_and_no_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    runs = contenders([entry(name, drives([score] * 8)) for name, score in (("low", 10.0), ("high", 90.0))])
    first = compare_places(*runs)
    with monkeypatch.context() as patch:
        patch.setattr(board, "paired", None)  # it would be an error
        assert compare_places(*runs) == first
    arrays = [weakref.ref(run.values) for run in runs]
    del runs
    gc.collect()
    assert [one() for one in arrays] == [None, None]


@pytest.mark.parametrize(("differing", "told"), [(5, False), (6, True)])
def test_a_row_has_no_probability_where_too_few_drives_differ_from_the_row_above(differing: int, told: bool) -> None:
    low = drives([10.0] * differing + [90.0] * (8 - differing))
    above = compare_places(*contenders([entry("low", low), entry("high", drives([90.0] * 8))]))
    assert above is not None
    assert above["difference"]["high"] < 0.0
    assert (above["verdict"], above["probability"]) == (("<", 0.0) if told else ("=", None))


def test_entries_without_a_significant_difference_share_a_rank() -> None:
    a = entry("a", drives([60.0, 40.0] * 4))
    b = entry("b", drives([40.0, 59.0, 41.0, 58.0] * 2))
    c = entry("c", drives([1.0, 2.0] * 4))
    assert ranked([c, b, a]) == [(1, "a"), (1, "b"), (3, "c")]


def test_a_tie_reaches_only_as_far_as_the_best_of_its_rank() -> None:
    # Each is a little worse than the one above on noisy drives, but the last is clearly worse than the first.
    noise = [0.0, 20.0, -20.0, 10.0, -10.0, 5.0]
    first = entry("first", drives([70.0] * 6))
    second = entry("second", drives([68.0 + one for one in noise]))
    third = entry("third", drives([66.0] * 6))
    assert ranked([first, second, third]) == [(1, "first"), (1, "second"), (3, "third")]


def test_many_at_once_get_the_verdicts_of_the_paired_comparison() -> None:
    generator = np.random.default_rng(0)
    levels = [float(70 - step / 3) for step in range(60)]
    runs = contenders(
        [entry(f"a{n:02}", drives(list(np.clip(generator.normal(m, 12, 18), 0, 100)))) for n, m in enumerate(levels)]
    )
    places = Ranks().rank(places_of(runs))
    assert len({place.rank for place in places}) > 3
    best = places[0]
    for position, place in enumerate(places[1:], 1):
        lower = compare_places(place.contender, best.contender)
        assert lower is not None
        if lower["verdict"] == "<":
            best = place
            assert place.rank == position + 1
        else:
            assert place.rank == best.rank


def test_what_was_ranked_before_gets_the_same_ranks_beside_a_new_run() -> None:
    generator = np.random.default_rng(1)
    entries = [entry(f"a{n}", drives(list(generator.normal(50 - n, 9, 12)))) for n in range(30)]
    ranks = Ranks()
    ranks.rank(places_of(contenders(entries[:-1])))
    again = ranks.rank(places_of(contenders(entries)))
    assert again == Ranks().rank([place.contender for place in again])


def test_equal_means_come_in_the_order_of_time() -> None:
    assert ranked([entry("b", drives([50.0] * 3)), entry("a", drives([50.0] * 3))]) == [(1, "b"), (1, "a")]


def test_without_the_same_drives_the_means_decide() -> None:
    entries = [entry("a", drives([50.0] * 3)), entry("b", drives([40.0] * 4))]
    assert ranked(entries) == [(1, "a"), (2, "b")]
    assert compare_places(*contenders(entries)) is None


def test_of_the_runs_of_an_entrant_the_best_is_its_place() -> None:
    runs = contenders([entry("early", drives([40.0])), entry("best", drives([90.0])), entry("late", drives([60.0]))])
    same = [dataclasses.replace(one, entrant="team") for one in runs]
    assert [one.evaluation for one in places_of(same)] == ["ev-best"]


def losing(name: str, score: float, lost: int, total: int = 20) -> Entry:
    """A run with so many drives of one score, and others lost."""
    made = drives([score] * total)
    return entry(name, made[lost:], gridlocked=tuple(made[:lost]))


def test_who_loses_more_than_a_tenth_of_its_drives_has_no_rank() -> None:
    entries = [losing("twentieth", 50.0, 1), losing("tenth", 80.0, 2), losing("more", 99.0, 3)]
    assert ranked(entries) == [(1, "tenth"), (2, "twentieth"), (None, "more")]


def test_who_loses_more_drives_stands_further_down_whatever_its_mean() -> None:
    entries = [losing("nineteen", 100.0, 19), losing("five", 20.0, 5), losing("none", 1.0, 0), losing("also", 40.0, 5)]
    assert ranked(entries) == [(1, "none"), (None, "also"), (None, "five"), (None, "nineteen")]


def test_of_two_runs_the_one_that_may_have_a_rank_is_the_place() -> None:
    runs = [
        dataclasses.replace(one, entrant="team") for one in contenders([losing("few", 99.0, 15), losing("all", 9.0, 0)])
    ]
    assert [one.evaluation for one in places_of(runs)] == ["ev-all"]


def test_a_baseline_stands_between_the_ranks() -> None:
    runs = contenders([entry(name, drives([score] * 8)) for name, score in (("a", 90.0), ("base", 50.0), ("b", 10.0))])
    runs[1] = dataclasses.replace(runs[1], baseline=True)
    places = Ranks().rank(places_of(runs))
    assert [(place.rank, place.contender.evaluation) for place in places] == [
        (1, "ev-a"),
        (None, "ev-base"),
        (2, "ev-b"),
    ]


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
    entries = [entry("slow", drives([99.0])), entry("there", reaching)]
    assert ranked(entries, "nocrash_success")[0] == (1, "there")


def test_csv_parses_back() -> None:
    entries = [entry("=cmd()", drives([50.0, 60.0])), entry('b "x", y', drives([10.0, 20.0]))]
    rows = [row(one, index) for index, one in enumerate(entries)]
    table = list(csv.DictReader(io.StringIO(as_csv(rows, "driving_score", Family.DRIVING))))
    assert [line["agent"] for line in table] == ["'=cmd()", 'b "x", y']
    for line, one in zip(table, rows, strict=True):
        for name in COLUMNS:
            assert float(line[name]) == one["scores"][name]["mean"]
            assert float(line[f"{name}_low"]) == one["scores"][name]["low"]
    assert (table[0]["verdict_above"], table[1]["verdict_above"]) == ("", "<")


def row(one: Entry, index: int) -> dict[str, Any]:
    """A row of a board, as its route makes it."""
    names = ("agent", "version", "owner", "kind", "track", "evaluation", "dohyo_versions")
    above = {"verdict": "<", "probability": 0.0} if index else None
    plain = {name: getattr(one, name) for name in names} | facts_of(one, "driving_score")
    return plain | {"rank": 1, "team": None, "verified": True, "baseline": False, "runs": 1, "thrown_away": 0,
                    "seeds": 1, "lost_too_many": False, "unranked": None, "above": above}  # fmt: skip


def test_an_empty_leaderboard_is_empty() -> None:
    assert Ranks().rank([]) == []


def closed_loop(score: float, progress_m: float) -> Drive:
    """A drive that came so far, with a closed-loop score of so much."""
    (facts,) = summary_of(episode(ego(progress_m=progress_m)), "2.0", {"ego": terms(score / 100.0, 1.0)})["egos"]
    return Drive("ep", "scenario", "cell", 0, facts)


def test_a_closed_loop_benchmark_ranks_by_that_score_alone() -> None:
    entries = [entry("far", [closed_loop(50.0, 900.0)]), entry("near", [closed_loop(75.0, 100.0)])]
    assert [name for _, name in ranked(entries, "closed_loop")] == ["near", "far"]
    assert [name for _, name in ranked(entries, "driving_score")] == ["far", "near"]
    header = as_csv([row(one, 0) for one in entries], "closed_loop", Family.DRIVING).splitlines()[0].split(",")
    assert {"closed_loop", "closed_loop_low", "no_collision", "comfort_high", "driving_score"} <= set(header)


def test_drives_without_a_reference_show_no_closed_loop_score_neither_do_no_drives() -> None:
    assert "closed_loop" not in entry("running", []).scores
    assert "closed_loop" not in entry("carla", drives([50.0])).scores
    assert "closed_loop" in entry("nuplan", [closed_loop(50.0, 900.0)]).scores
