"""Ranked runs in which the traffic was gridlocked: on the board by their other drives, compared on common ones."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from sqlalchemy import select

from dohyo.evaluation.records.specifications import Status
from dohyo.service.accounts.model import Role
from dohyo.service.boards.board import compare_places
from dohyo.service.boards.leaderboard import Ranks, places_of
from dohyo.service.boards.model import Ranking
from dohyo.service.boards.standings import Standings
from dohyo.service.challenges.closing import final_rows
from dohyo.service.evaluations.model import AttemptOutcome
from dohyo.service.evaluations.scoring import summary_of
from dohyo.service.evaluations.versions import EARLIER
from dohyo.service.scheduling import queue
from dohyo.service.scheduling.attempts import AttemptEnd
from dohyo.service.scheduling.queue import NO_SCORE
from tests.evaluation.builders import ego, episode
from tests.service.boards.test_leaderboard import contenders
from tests.service.challenges.driving import admit, end, enter, make_challenge
from tests.service.evaluations.test_scoring import drives_of, entry
from tests.service.harness import Caller, Harness, assert_problem

DRIVES = 18
"""Of a run on quickstart: six missions, three seeds."""


def facts(score: float | None) -> dict[str, Any]:
    """The summary of an episode with a driving score; of None: the traffic was gridlocked."""
    status = Status.TIMED_OUT if score is not None else Status.GRIDLOCK
    made = episode(ego(status=status, progress_m=10.0 * (90.0 if score is None else score)))
    return json.loads(json.dumps(summary_of(made, "2.0")))  # type: ignore[no-any-return]


def drive(service: Harness, run: str, scores: Mapping[int, float | None]) -> None:
    """Drives a run's episodes, as the scheduler stores them: scores by position, 50 for others."""
    while True:
        with service.services.database.session() as session:
            waiting = [one for one in queue.waiting(session) if one.evaluation_id == run]
            ticket = queue.take(session, waiting[0]) if waiting else None
        if ticket is None:
            return
        summary = facts(scores.get(ticket.position, 50.0))
        with service.services.database.session() as session:
            ended = AttemptEnd(AttemptOutcome.DONE)
            assert queue.finish(session, ticket, f"{ticket.position:064x}", summary, ended)


def ranked(caller: Caller, agent: str) -> str:
    caller.agent(agent)
    order = {"agent": agent, "benchmark": "quickstart", "ranked": True}
    answer = caller.post("/v1/evaluations", order)
    assert answer.status_code == 201, answer.text
    identifier: str = answer.json()["id"]
    return identifier


def board(service: Harness) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = service.client.get("/v1/leaderboard?benchmark=quickstart").json()["rows"]
    return rows


def test_a_run_with_a_gridlocked_drive_is_done_and_has_a_place(stored: Harness) -> None:
    eve = stored.caller("eve")
    run = ranked(eve, "a")
    drive(stored, run, {3: None})
    state = stored.client.get(f"/v1/evaluations/{run}").json()
    assert (state["status"], state["failure"], state["progress"]["done"]) == ("done", None, DRIVES)
    (row,) = board(stored)
    assert (row["evaluation"], row["drives"], row["lost"]) == (run, DRIVES - 1, 1)
    score = row["scores"]["driving_score"]
    assert (score["mean"], score["n"]) == (pytest.approx(50.0), DRIVES - 1)


def test_nothing_is_driven_again_by_resume(service: Harness) -> None:
    eve = service.caller("eve")
    run = ranked(eve, "a")
    drive(service, run, {3: None})
    answer = eve.post(f"/v1/evaluations/{run}/resume")
    assert (answer.status_code, answer.json()["status"]) == (200, "done")
    assert answer.json()["progress"]["queued"] == 0


def test_lost_drives_stand_beside_the_means_in_documents_and_tables(service: Harness) -> None:
    eve = service.caller("eve")
    run = ranked(eve, "a")
    drive(service, run, {0: None, 1: None})
    whole = service.client.get(f"/v1/evaluations/{run}/metrics").json()["all"]
    assert (whole["drives"], whole["lost"]) == (DRIVES - 2, 2)
    assert whole["scores"]["driving_score"]["mean"] == pytest.approx(50.0)
    assert whole["scores_lost_as_zero"]["driving_score"]["mean"] == pytest.approx(50.0 * (DRIVES - 2) / DRIVES)
    rows = table(service, f"/v1/evaluations/{run}/metrics.csv")
    assert [(row["drives"], row["lost"]) for row in rows if row["row"] == "all"] == [(str(DRIVES - 2), "2")]
    assert sum(row["row"] == "drive" for row in rows) == DRIVES - 2
    (row,) = table(service, "/v1/leaderboard.csv?benchmark=quickstart")
    assert (row["drives"], row["lost"]) == (str(DRIVES - 2), "2")


def table(service: Harness, path: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(service.client.get(path).text)))


def test_runs_that_lost_different_drives_are_compared_on_the_drives_of_both(service: Harness) -> None:
    """Each drive of the second run is 1 below that of the first; drives that are next to each other differ by 3."""
    eve = service.caller("eve")
    steps = {position: 20.0 + 3.0 * position for position in range(DRIVES)}
    above, below = ranked(eve, "above"), ranked(eve, "below")
    drive(service, above, steps | {0: None})
    drive(service, below, {position: score - 1.0 for position, score in steps.items()} | {DRIVES - 1: None})
    first, second = board(service)
    assert [(one["agent"], one["rank"], one["lost"]) for one in (first, second)] == [("above", 1, 1), ("below", 2, 1)]
    difference = second["above"]["difference"]
    assert (difference["n"], second["above"]["verdict"]) == (DRIVES - 2, "<")
    assert [difference[end] for end in ("mean", "low", "high")] == [pytest.approx(-1.0)] * 3


def test_a_run_that_lost_all_drives_has_no_place_and_says_why(service: Harness) -> None:
    eve = service.caller("eve")
    nothing, other = ranked(eve, "nothing"), ranked(eve, "other")
    drive(service, nothing, dict.fromkeys(range(DRIVES)))
    drive(service, other, {})
    state = service.client.get(f"/v1/evaluations/{nothing}").json()
    assert (state["status"], state["failure"]) == ("done", NO_SCORE)
    assert [row["evaluation"] for row in board(service)] == [other]
    answer = service.client.get(f"/v1/comparison?evaluation={nothing}&evaluation={other}")
    assert_problem(answer, 422, "lost all of its drives")
    whole = service.client.get(f"/v1/evaluations/{nothing}/metrics").json()["all"]
    assert (whole["drives"], whole["lost"], whole["scores"]["driving_score"]["mean"]) == (0, DRIVES, None)


def test_a_run_of_a_few_good_drives_is_below_all_that_drove_the_benchmark(service: Harness) -> None:
    eve = service.caller("eve")
    few, whole = ranked(eve, "few"), ranked(eve, "whole")
    drive(service, few, {position: 99.0 if position < 5 else None for position in range(DRIVES)})
    drive(service, whole, {})
    rows = [(row["agent"], row["rank"], row["lost"], row["lost_too_many"]) for row in board(service)]
    assert rows == [("whole", 1, 0, False), ("few", None, DRIVES - 5, True)]
    lines = table(service, "/v1/leaderboard.csv?benchmark=quickstart")
    assert [(one["rank"], one["lost_too_many"]) for one in lines] == [("1", "False"), ("", "True")]


def test_nobody_wins_a_phase_by_losing_drives(service: Harness) -> None:
    organiser = service.caller("org", Role.ORGANISER)
    ranking = make_challenge(organiser, draw_seeds=1)
    ann = admit(service, organiser, "ann", team="A")
    ann.agent("a")
    drive(service, enter(ann, "a", ranking)["id"], {0: 99.0} | dict.fromkeys(range(1, 6)))
    end(service.services.database, ranking)
    assert [(row["rank"], row["lost_too_many"]) for row in rows_at_the_end(service, ranking)] == [(None, True)]
    (announced,) = organiser.get("/v1/challenges/cup").json()["announcements"]
    assert (announced["places"], announced["winners"]) == (1, [])


def test_a_final_board_tells_of_lost_drives_and_one_of_before_of_none(service: Harness) -> None:
    organiser = service.caller("org", Role.ORGANISER)
    ranking = make_challenge(organiser, draw_seeds=1)
    ann = admit(service, organiser, "ann", team="A")
    ann.agent("a")
    run = enter(ann, "a", ranking)["id"]
    drive(service, run, {2: None})
    end(service.services.database, ranking)
    assert [row["lost"] for row in rows_at_the_end(service, ranking)] == [1]
    with service.services.database.session() as session:
        one = session.scalars(select(Ranking).where(Ranking.id == ranking)).one()
        assert one.final is not None
        of_now = ("lost", "lost_too_many", "unranked", "dohyo_versions")
        rows = [{key: value for key, value in row.items() if key not in of_now} for row in one.final["rows"]]
        one.final = one.final | {"rows": rows}
    (row,) = rows_at_the_end(service, ranking)
    assert (row["lost"], row["lost_too_many"], row["unranked"]) == (0, False, None)
    assert row["dohyo_versions"] == [EARLIER]


def rows_at_the_end(service: Harness, ranking: str) -> list[dict[str, Any]]:
    database = service.services.database
    with database.reading() as session:
        found = session.get_one(Ranking, ranking)
    return final_rows(database, Standings(), found, "driving_score")


def test_runs_without_a_drive_that_counts_in_both_are_not_compared() -> None:
    runs = []
    for name, kept in (("a", 60.0), ("b", 40.0)):
        drives = {
            number: drives_of(episode(ego(progress_m=10.0 * kept), name=f"s{number}"), f"ep{number}")
            for number in range(4)
        }
        halves = ((0, 1), (2, 3)) if name == "a" else ((2, 3), (0, 1))
        mine, lost = ([one for number in half for one in drives[number]] for half in halves)
        runs += contenders([entry(name, mine, gridlocked=tuple(lost))])
    assert all(np.isnan(run.values).sum() == 2 for run in runs)
    places = Ranks().rank(places_of(runs))
    assert [(place.rank, place.contender.evaluation) for place in places] == [(None, "ev-a"), (None, "ev-b")]
    assert compare_places(*runs) is None
