"""Upgrades of dohyo: a board ranks the runs of one version, since another one may simulate and judge otherwise."""

from __future__ import annotations

import csv
import io
import random
from importlib.metadata import version
from typing import Any

import pytest

from dohyo.evaluation.records.record import Versions
from dohyo.service.accounts.model import Role
from dohyo.service.evaluations.model import AttemptOutcome
from dohyo.service.evaluations.scoring import summary_of
from dohyo.service.evaluations.versions import EARLIER, newest, version_order
from dohyo.service.scheduling import queue
from dohyo.service.scheduling.attempts import AttemptEnd
from tests.evaluation.builders import ego, episode
from tests.service.boards.test_ranked_runs import board, order
from tests.service.challenges.driving import admit, complete, end, enter, make_challenge
from tests.service.harness import Caller, Harness

OLD, NEW = "0.2.0", "0.10.0"
"""In the order of versions, which is not that of letters."""


def run(service: Harness, caller: Caller, agent: str, score: float, *dohyo: str) -> str:
    """A complete ranked run, driven with these versions."""
    identifier: str = order(caller, agent=agent).json()["id"]
    complete(service.services.database, identifier, score, dohyo=dohyo)
    return identifier


def facts(rows: list[dict[str, Any]]) -> list[tuple[Any, ...]]:
    return [(row["agent"], row["rank"], row["unranked"], row["dohyo_versions"]) for row in rows]


def drive(service: Harness, run_id: str, episodes: int, dohyo: str) -> None:
    """Drives some episodes of a run, as the scheduler stores them."""
    made = episode(ego())
    made = made.model_copy(update={"versions": made.versions.model_copy(update={"dohyo": dohyo})})
    for _ in range(episodes):
        with service.services.database.session() as session:
            (waiting,) = [one for one in queue.waiting(session) if one.evaluation_id == run_id]
            ticket = queue.take(session, waiting)
            assert ticket is not None
            ended = AttemptEnd(AttemptOutcome.DONE)
            assert queue.finish(session, ticket, f"{ticket.position:064x}", summary_of(made, "2.0"), ended)


@pytest.fixture
def eve(service: Harness) -> Caller:
    """An owner of three agents."""
    caller = service.caller("eve")
    for agent in ("a", "b", "c"):
        caller.agent(agent)
    return caller


def test_runs_of_before_keep_their_ranks_until_one_of_the_new_version_is_complete(
    service: Harness, eve: Caller
) -> None:
    run(service, eve, "a", 90.0, OLD)
    run(service, eve, "b", 40.0, OLD)
    assert facts(board(service)) == [("a", 1, None, [OLD]), ("b", 2, None, [OLD])]
    run(service, eve, "c", 10.0, NEW)
    assert facts(board(service)) == [
        ("c", 1, None, [NEW]),
        ("a", None, "other_version", [OLD]),
        ("b", None, "other_version", [OLD]),
    ]


def test_runs_of_two_versions_are_not_compared_drive_by_drive(service: Harness, eve: Caller) -> None:
    run(service, eve, "a", 90.0, OLD)
    run(service, eve, "b", 40.0, OLD)
    run(service, eve, "c", 10.0, NEW)
    _, first_old, second_old = board(service)
    assert first_old["above"] is None
    assert second_old["above"]["verdict"] == "<"


def test_a_run_that_two_versions_drove_is_below_all_others(service: Harness, eve: Caller) -> None:
    run(service, eve, "a", 90.0, OLD, NEW)
    run(service, eve, "b", 40.0, OLD)
    run(service, eve, "c", 10.0, NEW)
    assert facts(board(service)) == [
        ("c", 1, None, [NEW]),
        ("b", None, "other_version", [OLD]),
        ("a", None, "other_version", [OLD, NEW]),
    ]


def test_after_an_upgrade_an_agent_may_be_driven_again_for_its_place(service: Harness, eve: Caller) -> None:
    run(service, eve, "a", 90.0, OLD)
    again = run(service, eve, "a", 50.0, NEW)
    run(service, eve, "a", 99.0, NEW)  # no second chance with this version
    (row,) = board(service)
    assert (row["evaluation"], row["rank"], row["runs"]) == (again, 1, 3)


def test_a_run_that_waits_keeps_later_ones_from_the_board_whatever_drives_them(service: Harness, eve: Caller) -> None:
    """Who orders, cancels and orders again gets no choice among runs by that."""
    cancelled = order(eve).json()["id"]
    assert eve.post(f"/v1/evaluations/{cancelled}/cancel").status_code == 200
    run(service, eve, "a", 90.0, NEW)
    assert board(service) == []


def test_a_run_that_an_upgrade_interrupted_tells_both_versions(stored: Harness) -> None:
    eve = stored.caller("eve")
    eve.agent("a")
    identifier = order(eve).json()["id"]
    assert stored.client.get(f"/v1/evaluations/{identifier}").json()["dohyo_versions"] == []
    drive(stored, identifier, 3, OLD)
    assert stored.client.get(f"/v1/evaluations/{identifier}").json()["dohyo_versions"] == [OLD]
    drive(stored, identifier, 15, NEW)
    state = stored.client.get(f"/v1/evaluations/{identifier}").json()
    assert (state["status"], state["dohyo_versions"]) == ("done", [OLD, NEW])
    assert facts(board(stored)) == [("a", None, "other_version", [OLD, NEW])]


def test_a_baseline_of_a_new_version_takes_no_rank_from_others(service: Harness) -> None:
    organiser = service.caller("org", Role.ORGANISER)
    ranking = make_challenge(organiser, draw_seeds=1)
    ann = admit(service, organiser, "ann", team="A")
    ann.agent("a")
    complete(service.services.database, enter(ann, "a", ranking)["id"], 40.0, dohyo=(OLD,))
    organiser.agent("base")
    assert organiser.post("/v1/challenges/cup/baselines", {"agent": "base"}).status_code == 201
    complete(service.services.database, enter(organiser, "base", ranking)["id"], 90.0, dohyo=(NEW,))
    rows = service.client.get(f"/v1/leaderboard?ranking={ranking}").json()["rows"]
    assert facts(rows) == [("a", 1, None, [OLD]), ("base", None, "other_version", [NEW])]


def test_the_final_board_of_a_phase_outlives_an_upgrade(service: Harness) -> None:
    organiser = service.caller("org", Role.ORGANISER)
    ranking = make_challenge(organiser, draw_seeds=1)
    runs = {}
    for name in ("ann", "bob"):
        caller = admit(service, organiser, name, team=name)
        caller.agent(name)
        runs[name] = enter(caller, name, ranking)["id"]
    complete(service.services.database, runs["ann"], 40.0, dohyo=(OLD,))
    end(service.services.database, ranking)
    expected = [("ann", 1, None, [OLD])]
    assert facts(service.client.get(f"/v1/leaderboard?ranking={ranking}").json()["rows"]) == expected
    complete(service.services.database, runs["bob"], 90.0, dohyo=(NEW,))
    assert facts(service.client.get(f"/v1/leaderboard?ranking={ranking}").json()["rows"]) == expected


def test_the_table_tells_versions_and_why_there_is_no_rank(service: Harness, eve: Caller) -> None:
    run(service, eve, "a", 90.0, OLD, NEW)
    run(service, eve, "b", 10.0, NEW)
    lines = csv.DictReader(io.StringIO(service.client.get("/v1/leaderboard.csv?benchmark=quickstart").text))
    told = [(line["agent"], line["rank"], line["unranked"], line["dohyo_versions"]) for line in lines]
    assert told == [("b", "1", "", NEW), ("a", "", "other_version", f"{OLD} {NEW}")]


def test_a_comparison_tells_the_version_of_each_side(service: Harness, eve: Caller) -> None:
    sides = [run(service, eve, "a", 90.0, OLD), run(service, eve, "b", 40.0, NEW)]
    document = service.client.get("/v1/comparison", params={"evaluation": sides}).json()
    assert [one["dohyo_versions"] for one in document["evaluations"]] == [[OLD], [NEW]]


def test_an_episode_is_noted_with_the_version_of_its_record_and_not_of_the_service() -> None:
    """An earlier service may have left the record behind."""
    made = episode(ego())
    before = made.model_copy(update={"versions": Versions(dohyo=OLD, sumo="1.28.0", network_sha256="1" * 64)})
    assert [summary_of(one, "2.0")["dohyo"] for one in (made, before)] == [version("dohyo"), OLD]


def test_versions_are_in_the_order_of_releases() -> None:
    ordered = [EARLIER, "0.1.0", "0.2.0.dev1", "0.2.0rc1", "0.2.0", "0.10.0", "1.0.0"]
    shuffled = random.Random(0).sample(ordered, len(ordered))
    assert sorted(shuffled, key=version_order) == ordered
    assert newest(shuffled) == "1.0.0"
    assert newest([]) is None
