from __future__ import annotations

import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dohyo.evaluation.records.record import AgentInfo, EpisodeRecord
from dohyo.evaluation.records.specifications import InfractionKind, Status
from dohyo.evaluation.summary import SCORES, as_document, compare, summarise, summarise_cells
from dohyo.sumo_networks.errors import InvalidInputError
from tests.evaluation.builders import AGENT, ego, episode, infraction, lost

RED = infraction(InfractionKind.RED_LIGHT)
HIT = infraction(InfractionKind.COLLISION_VEHICLE, route_m=200.0)


def some_episodes(n: int = 6) -> list[EpisodeRecord]:
    """Even ones reach the goal, every third hits a car; the progress differs."""
    return [
        episode(
            ego(
                *([HIT] if seed % 3 == 0 else []),
                status=Status.TIMED_OUT if seed % 2 else Status.COMPLETED,
                progress_m=137.0 * (seed + 1),
            ),
            seed=seed,
        )
        for seed in range(n)
    ]


def test_means_are_of_per_drive_scores() -> None:
    clean = episode(ego(status=Status.PERFECT, progress_m=1000.0), seed=0)
    poor = episode(ego(RED, progress_m=500.0), seed=1)
    summary = summarise([clean, poor])
    means = {name: summary.scores[name].mean for name in SCORES}
    assert means["success"] == means["nocrash_success"] == 50.0
    assert means["route_completion"] == pytest.approx(75.0)
    assert means["infraction_penalty"] == pytest.approx(0.85)
    assert means["driving_score"] == pytest.approx((100.0 + 50.0 * 0.7) / 2)
    assert summary.per_km["red_light"].mean == pytest.approx(1 / 1.5)
    assert set(summary.per_km) == {kind.value for kind in InfractionKind}
    assert summary.statuses == {"perfect": 1, "failed: agent ran out of time": 1}
    assert (summary.agent, summary.benchmark) == ("tester", "nocrash")
    assert summary.km == pytest.approx(1.5)


def test_a_crash_spoils_nocrash_only() -> None:
    summary = summarise([episode(ego(HIT, status=Status.COMPLETED))])
    assert summary.scores["success"].mean == 100.0
    assert summary.scores["nocrash_success"].mean == 0.0


def test_all_egos_of_an_episode_count() -> None:
    summary = summarise([episode(ego(name="a"), ego(name="b", status=Status.COMPLETED))])
    assert summary.episodes == 1
    assert summary.scores["success"].n == 2


def test_rules_and_length_are_passed_on_and_told() -> None:
    records = [episode(ego(HIT, HIT, RED, driven_m=5000.0))]
    summary = summarise(records, rules="2.1", irs_length="route")
    assert summary.scores["driving_score"].mean == pytest.approx(28.57, abs=0.005)
    assert (summary.rules, summary.irs_length) == ("2.1", "route")
    assert summary.scores["irs"].mean != summarise(records).scores["irs"].mean


@settings(max_examples=20, deadline=None)
@given(st.permutations([*some_episodes(), lost(seed=99)]))
def test_the_order_of_records_does_not_matter(records: list[EpisodeRecord]) -> None:
    assert summarise(records) == summarise([*some_episodes(), lost(seed=99)])
    assert compare(records, some_episodes(4)) == compare(some_episodes(), some_episodes(4))


def test_a_lost_episode_never_enters_a_mean() -> None:
    without, with_lost = summarise(some_episodes()), summarise([*some_episodes(), lost(seed=99)])
    assert with_lost.lost == 1
    assert with_lost.scores == without.scores
    assert with_lost.per_km == without.per_km
    assert with_lost.statuses == without.statuses
    assert with_lost.episodes == without.episodes == 6


def test_lost_drives_count_as_zero_beside_the_mean_that_leaves_them_out() -> None:
    gridlocked = episode(ego(name="a", status=Status.GRIDLOCK), ego(name="b", status=Status.COMPLETED), seed=98)
    clean = episode(ego(status=Status.PERFECT, progress_m=1000.0))
    assert summarise([clean]).scores_lost_as_zero is None
    summary = summarise([clean, lost(seed=99), gridlocked])
    assert summary.scores_lost_as_zero is not None
    assert (summary.scores["driving_score"].mean, summary.scores["driving_score"].n) == (100.0, 1)
    for name in SCORES:
        as_zero = summary.scores_lost_as_zero[name]
        assert (as_zero.mean, as_zero.n) == (pytest.approx((summary.scores[name].mean or 0.0) / 4), 4)


def test_the_lost_drives_of_an_episode_are_one_episode_in_intervals() -> None:
    """Of two whole episodes and a lost one, resamples may hold the lost one alone."""
    egos = [ego(name=f"e{i}", status=Status.PERFECT, progress_m=1000.0) for i in range(8)]
    gone = episode(*egos[1:], ego(name="e0", status=Status.GRIDLOCK), seed=2)
    summary = summarise([episode(*egos, seed=0), episode(*egos, seed=1), gone])
    assert summary.scores_lost_as_zero is not None
    for name in ("success", "driving_score"):
        found = summary.scores_lost_as_zero[name]
        assert (found.mean, found.low, found.high, found.n) == (pytest.approx(200 / 3), 0.0, 100.0, 24)


def test_a_lost_episode_takes_its_other_egos_with_it() -> None:
    half = episode(ego(name="a", status=Status.COMPLETED), ego(name="b", status=Status.SIMULATION), seed=99)
    assert summarise([*some_episodes(), half]).scores == summarise(some_episodes()).scores


def test_nothing_but_lost_episodes() -> None:
    summary = summarise([lost(seed=0), lost(seed=1)])
    assert (summary.episodes, summary.lost, summary.km) == (0, 2, 0.0)
    assert {estimate.mean for estimate in (summary.scores | summary.per_km).values()} == {None}


def test_a_cell_with_nothing_but_unrecorded_drives_is_there_if_any_record_is() -> None:
    cells = summarise_cells([episode(ego(), cell="town")], unrecorded={"gone": 2, "none": 0})
    assert {cell: (one.agent, one.episodes, one.lost) for cell, one in cells.items()} == {
        "town": (AGENT.name, 1, 0),
        "gone": (AGENT.name, 0, 2),
    }
    assert summarise_cells([], unrecorded={"gone": 2}) == {}


def test_an_agents_failure_is_no_excuse() -> None:
    summary = summarise([episode(ego(status=Status.AGENT_RAISED, progress_m=0.0))])
    assert summary.lost == 0
    assert summary.scores["driving_score"].mean == 0.0


def test_the_document_is_plain_json() -> None:
    document = as_document(summarise([*some_episodes(), lost(seed=99)]))
    assert json.loads(json.dumps(document, allow_nan=False)) == document
    assert document["scores"]["irs"].keys() == {"mean", "low", "high", "n"}


def test_mixtures_and_repeats_are_rejected() -> None:
    tuned = AgentInfo(**{**AGENT.model_dump(), "settings": {"gap_s": 1.0}})
    with pytest.raises(InvalidInputError, match="at least one record"):
        summarise([])
    with pytest.raises(InvalidInputError, match="one agent"):
        summarise([episode(seed=0), episode(ego(agent=tuned), seed=1)])
    with pytest.raises(InvalidInputError, match="one benchmark"):
        summarise([episode(seed=0), episode(seed=1, benchmark=None)])
    with pytest.raises(InvalidInputError, match="comes 2 times"):
        summarise([episode(seed=3), episode(seed=3)])


def test_comparison_is_paired_by_scenario_seed_and_ego() -> None:
    worse = [episode(ego(RED, progress_m=137.0 * (seed + 1)), seed=seed) for seed in range(20)]
    better = [episode(ego(progress_m=137.0 * (seed + 1)), seed=seed) for seed in reversed(range(20))]
    comparison = compare(better, worse)
    assert set(comparison) == set(SCORES)
    assert comparison["driving_score"].verdict == ">"
    assert comparison["route_completion"].verdict == "="
    assert comparison["route_completion"].difference.mean == 0.0
    assert compare(worse, better)["driving_score"].verdict == "<"


def test_egos_of_an_episode_are_one_pair() -> None:
    """Eight egos meet the same traffic, and each other."""
    good = [ego(name=f"e{i}", progress_m=1000.0 - i, status=Status.COMPLETED) for i in range(8)]
    poor = [ego(name=f"e{i}", progress_m=500.0) for i in range(8)]
    found = compare([episode(*good)], [episode(*poor)])["driving_score"]
    assert (found.difference.n, found.verdict, found.probability) == (1, "=", None)
    six = ([episode(*some, seed=seed) for seed in range(6)] for some in (good, poor))
    assert compare(*six)["driving_score"].verdict == ">"


def test_intervals_are_over_episodes() -> None:
    egos = [ego(name=f"e{i}") for i in range(8)]
    apart = [episode(ego(), seed=seed, name=f"m{i}") for seed in range(2) for i in range(8)]
    together = [
        episode(*egos, seed=0),
        episode(*(one.model_copy(update={"infractions": (RED,)}) for one in egos), seed=1),
    ]
    assert summarise(apart).scores["driving_score"].n == 16
    scores = summarise(together).scores["driving_score"]
    assert (scores.n, scores.low, scores.high) == (16, pytest.approx(56.0), pytest.approx(80.0))


def test_only_drives_of_both_sides_are_compared() -> None:
    a, b = some_episodes(6), [*some_episodes(4), lost(seed=4), episode(seed=77)]
    assert compare(a, b)["success"].difference.n == 4


def test_comparisons_of_unlike_things_are_rejected() -> None:
    with pytest.raises(InvalidInputError, match="no drive in common"):
        compare([episode(name="one")], [episode(name="other")])
    with pytest.raises(InvalidInputError, match="not the same on both sides"):
        compare([episode()], [episode(time_limit_s=10.0)])
    with pytest.raises(InvalidInputError, match="comes twice"):
        compare([episode(), episode()], [episode()])
