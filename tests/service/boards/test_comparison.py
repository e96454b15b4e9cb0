from __future__ import annotations

from dataclasses import replace

import pytest

from dohyo.service.boards.comparison import compare_entries, differing_scenarios
from dohyo.service.boards.leaderboard import Entry
from dohyo.service.evaluations.scoring import FORECAST_SCORES
from dohyo.sumo_networks.errors import InvalidInputError
from tests.service.boards.test_leaderboard import drives
from tests.service.evaluations.test_scoring import entry


def test_pairs_are_compared_drive_by_drive() -> None:
    a, b = entry("a", drives([50.0, 60.0, 70.0] * 2)), entry("b", drives([40.0, 50.0, 60.0] * 2))
    document = compare_entries([a, b], "driving_score")
    (pair,) = document["pairs"]
    assert (pair["a"], pair["b"]) == ("ev-a", "ev-b")
    score = pair["scores"]["driving_score"]
    assert score["verdict"] == ">"
    assert score["probability"] == 1.0
    assert score["difference"]["mean"] == pytest.approx(10.0)
    assert (score["difference"]["low"], score["difference"]["high"]) == (pytest.approx(10.0), pytest.approx(10.0))
    assert [side["scores"]["driving_score"]["mean"] for side in document["evaluations"]] == pytest.approx([60.0, 50.0])


def test_only_drives_of_both_count() -> None:
    a, b = entry("a", drives([50.0, 60.0, 70.0])), entry("b", drives([90.0], scenarios=2))
    score = compare_entries([a, b], "driving_score")["pairs"][0]["scores"]["driving_score"]
    assert (score["difference"]["n"], score["difference"]["mean"]) == (1, pytest.approx(-20.0))
    c = entry("c", drives([1.0], scenarios=50))
    assert compare_entries([a, c], "driving_score")["pairs"][0]["scores"]["driving_score"] is None


def test_the_scenarios_on_which_they_differ_most_come_first() -> None:
    a = entry("a", drives([50.0, 90.0, 30.0, 10.0]))
    b = entry("b", drives([50.0, 20.0, 40.0, 15.0]))
    found = differing_scenarios([a, b], "driving_score", most=2)
    assert [(one["scenario"], one["spread"]) for one in found] == [
        ("scenario1", pytest.approx(70.0)),
        ("scenario2", pytest.approx(10.0)),
    ]
    assert found[0]["values"] == pytest.approx([90.0, 20.0])
    assert found[0]["episodes"] == ["ep1", "ep1"]
    # The first is the same for both, so it is never among them.
    assert "scenario0" not in [one["scenario"] for one in differing_scenarios([a, b], "driving_score")]


def test_where_success_is_equal_the_driving_score_orders() -> None:
    a, b = entry("a", drives([50.0, 90.0])), entry("b", drives([49.0, 20.0]))
    assert [one["scenario"] for one in differing_scenarios([a, b], "success")] == ["scenario1", "scenario0"]


def test_three_agents_make_three_pairs() -> None:
    entries = [entry(name, drives([score, score])) for name, score in (("a", 1.0), ("b", 2.0), ("c", 4.0))]
    document = compare_entries(entries, "driving_score")
    assert [(pair["a"], pair["b"]) for pair in document["pairs"]] == [
        ("ev-a", "ev-b"),
        ("ev-a", "ev-c"),
        ("ev-b", "ev-c"),
    ]
    assert document["scenarios"][0]["spread"] == pytest.approx(3.0)


def test_different_benchmark_versions_have_no_common_scale() -> None:
    a, b = entry("a", drives([1.0])), entry("b", drives([1.0]), benchmark_sha256="c" * 64)
    with pytest.raises(InvalidInputError, match="one benchmark version, got made bbbbbbbbbbbb, made cccccccccccc"):
        compare_entries([a, b], "driving_score")


def test_what_cannot_be_compared_is_refused() -> None:
    a, b = entry("a", drives([1.0])), entry("b", drives([1.0]))
    with pytest.raises(InvalidInputError, match="2 to 8"):
        compare_entries([a], "driving_score")
    with pytest.raises(InvalidInputError, match="different evaluations"):
        compare_entries([a, b, a], "driving_score")
    with pytest.raises(InvalidInputError, match="no finished episode"):
        compare_entries([a, entry("empty", [])], "driving_score")


def test_a_day_on_which_an_agent_failed_is_in_no_list_of_differing_scenarios() -> None:
    scores = dict.fromkeys(FORECAST_SCORES, 4.0)

    def days(name: str, *facts: dict[str, float]) -> Entry:
        made = zip(drives([0.0] * len(facts)), facts, strict=True)
        return entry(name, [replace(one, facts={"status": one.status.value, "forecast": fact}) for one, fact in made])

    a, b = days("a", scores, scores), days("b", {}, {**scores, "mse": 9.0})
    assert [one["scenario"] for one in differing_scenarios([a, b], "mse")] == ["scenario1"]
