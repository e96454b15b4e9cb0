"""Attacks on ranks: chosen seeds and deadlines, runs repeated until one is lucky, orders at the same moment."""

from __future__ import annotations

import threading
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest

from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.service.boards.rankings import open_ranking_id
from tests.service.challenges.driving import complete
from tests.service.clock import WrongClock
from tests.service.harness import Caller, Harness, assert_problem, running


def order(caller: Caller, **rest: Any) -> Any:
    return caller.post("/v1/evaluations", {"agent": "a", "benchmark": "quickstart", "ranked": True, **rest})


def board(service: Harness) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = service.client.get("/v1/leaderboard?benchmark=quickstart").json()["rows"]
    return rows


@pytest.mark.parametrize(
    ("chosen", "value"),
    [("seeds", [777]), ("act_deadline_s", 600.0), ("slow_policy", "wait")],
)
def test_nobody_chooses_the_conditions_of_a_ranked_run(service: Harness, chosen: str, value: Any) -> None:
    eve = service.caller("eve")
    eve.agent("a")
    answer = order(eve, **{chosen: value})
    assert_problem(answer, 422, f"body.{chosen}", "ranking fixes it")
    made = order(eve)
    assert made.status_code == 201
    assert made.json()["seeds"] == list(load_benchmark("quickstart").seeds)
    assert made.json()["act_deadline_s"] == service.services.settings.act_deadline_s


def test_a_practice_run_on_lucky_seeds_is_on_no_board(service: Harness) -> None:
    eve = service.caller("eve")
    eve.agent("a")
    ranked = order(eve).json()["id"]
    complete(service.services.database, ranked, 40.0)
    lucky = eve.evaluation("a", seeds=[777], act_deadline_s=600.0)
    complete(service.services.database, lucky, 99.0)
    (row,) = board(service)
    assert (row["evaluation"], row["runs"], row["seeds"]) == (ranked, 1, 3)


def test_a_lucky_repetition_does_not_replace_the_first_run_and_is_counted(service: Harness) -> None:
    eve = service.caller("eve")
    eve.agent("a")
    first, second, third = (order(eve).json()["id"] for _ in range(3))
    complete(service.services.database, second, 95.0)
    complete(service.services.database, first, 40.0)
    assert eve.post(f"/v1/evaluations/{third}/cancel").status_code == 200
    (row,) = board(service)
    assert (row["evaluation"], row["runs"]) == (first, 3)
    assert row["scores"]["driving_score"]["mean"] == pytest.approx(40.0)


def test_a_new_version_of_the_agent_gives_no_new_runs(tmp_path: Path) -> None:
    with running(tmp_path / "data", runs_per_day=2) as service:
        eve, ann = service.caller("eve"), service.caller("ann")
        eve.agent("a")
        cancelled = order(eve).json()["id"]
        eve.post(f"/v1/evaluations/{cancelled}/cancel")
        eve.post("/v1/agents/a/submissions", {"kind": "remote", "settings": {}})
        assert order(eve).status_code == 201
        answer = order(eve)
        assert_problem(answer, 429, "has ordered 2 of 2 ranked runs", "also cancelled ones")
        assert 86_000 < int(answer.headers["retry-after"]) <= 86_400
        eve.evaluation("a", seeds=[5])  # practice is free
        ann.agent("b")
        assert order(ann, agent="b").status_code == 201


def test_the_first_run_stays_the_first_where_the_clock_is_set_back(
    stored: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock, database, eve = WrongClock(monkeypatch), stored.services.database, stored.caller("eve")
    eve.agent("a")
    first = order(eve).json()["id"]
    complete(database, first, 40.0)
    clock.shift = timedelta(hours=-1)
    complete(database, order(eve).json()["id"], 90.0)
    (row,) = board(stored)
    assert (row["evaluation"], row["runs"]) == (first, 2)
    assert row["scores"]["driving_score"]["mean"] == pytest.approx(40.0)


def test_runs_of_a_time_when_the_clock_was_ahead_use_up_no_later_quota(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = WrongClock(monkeypatch)
    with running(tmp_path / "data", runs_per_day=2) as service:
        eve = service.caller("eve")
        eve.agent("a")
        clock.shift = timedelta(days=30)
        assert [order(eve).status_code for _ in range(3)] == [201, 201, 429]
        clock.shift = timedelta()
        answers = [order(eve) for _ in range(3)]
        assert [one.status_code for one in answers] == [201, 201, 429]
        assert 86_000 < int(answers[-1].headers["retry-after"]) <= 86_400


def test_all_versions_of_an_agent_have_one_place_which_is_that_of_the_best(service: Harness) -> None:
    """Of each version its first run counts, so that a repetition is no second chance."""
    eve, database = service.caller("eve"), service.services.database
    eve.agent("a")
    runs = []
    for score in (40.0, 60.0, 50.0):
        runs.append(order(eve).json()["id"])
        complete(database, runs[-1], score)
        eve.post("/v1/agents/a/submissions", {"kind": "remote", "settings": {}})
    complete(database, order(eve, version=3).json()["id"], 95.0)
    eve.agent("b")
    complete(database, order(eve, agent="b").json()["id"], 45.0)
    first, second = board(service)
    assert (first["agent"], first["version"], first["evaluation"], first["runs"]) == ("a", 2, runs[1], 4)
    assert (second["agent"], second["rank"], second["runs"]) == ("b", 2, 1)


def test_orders_at_the_same_moment_do_not_pass_the_quota(stored: Harness) -> None:
    eve = stored.caller("eve")
    eve.agent("a")
    most = stored.services.settings.runs_per_day
    for _ in range(most - 2):
        assert order(eve).status_code == 201
    answers: list[int] = []
    threads = [threading.Thread(target=lambda: answers.append(order(eve).status_code)) for _ in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert answers.count(201) == 2, answers
    assert set(answers) <= {201, 429, 503}
    listed = eve.get(f"/v1/evaluations?ranking={open_ranking_id(load_benchmark('quickstart').sha256)}").json()["items"]
    assert len(listed) == most


def test_the_same_key_makes_one_ranked_run_also_when_the_quota_is_used(tmp_path: Path) -> None:
    with running(tmp_path / "data", runs_per_day=1) as service:
        eve = service.caller("eve")
        eve.agent("a")
        body, key = {"agent": "a", "benchmark": "quickstart", "ranked": True}, {"idempotency-key": "k"}
        answers = [eve.post("/v1/evaluations", body, headers=key) for _ in range(2)]
        assert [one.status_code for one in answers] == [201, 201]
        assert answers[0].json()["id"] == answers[1].json()["id"]


def test_a_page_goes_on_after_the_last_row(service: Harness) -> None:
    eve = service.caller("eve")
    for number in range(5):
        eve.agent(f"a{number}")
        run = order(eve, agent=f"a{number}").json()["id"]
        complete(service.services.database, run, 10.0 * number)
    seen, after = [], None
    while True:
        params = {"benchmark": "quickstart", "limit": 2} | ({"after": after} if after else {})
        page = service.client.get("/v1/leaderboard", params=params).json()
        assert page["total"] == 5
        seen += [row["agent"] for row in page["rows"]]
        after = page["next"]
        if after is None:
            break
    assert seen == ["a4", "a3", "a2", "a1", "a0"]
    assert_problem(service.client.get("/v1/leaderboard?benchmark=quickstart&after=ev-0"), 422, "after")
    assert_problem(service.client.get("/v1/leaderboard?benchmark=quickstart&ranking=rk-0"), 422, "either")


def test_cancelling_a_bad_first_run_gives_no_choice_among_runs(service: Harness) -> None:
    eve, database = service.caller("eve"), service.services.database
    eve.agent("a")
    bad, lucky = (order(eve).json()["id"] for _ in range(2))
    assert eve.post(f"/v1/evaluations/{bad}/cancel").status_code == 200
    complete(database, lucky, 95.0)
    assert board(service) == []
    assert eve.post(f"/v1/evaluations/{bad}/resume").status_code == 200
    complete(database, bad, 40.0)
    (row,) = board(service)
    assert (row["evaluation"], row["runs"]) == (bad, 2)
