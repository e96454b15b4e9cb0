"""The life of a challenge through the interface, on both databases."""

from __future__ import annotations

import re
import threading
from datetime import timedelta
from typing import Any

import httpx
import pytest
from sqlalchemy import event, select, update

from dohyo.service.accounts.model import Role
from dohyo.service.boards.model import Ranking
from dohyo.service.challenges.closing import close_ended
from dohyo.service.challenges.model import Invitation
from dohyo.service.database.base import now
from dohyo.service.evaluations.model import BenchmarkVersion, Evaluation, EvaluationStatus
from dohyo.service.scheduling import queue
from dohyo.service.webhooks.model import Delivery
from tests.service.challenges.driving import admit, complete, end, enter, in_days, make_challenge
from tests.service.harness import Caller, Harness, assert_problem
from tests.service.served import wait_until


def rows(caller: Any, ranking: str) -> list[tuple[Any, ...]]:
    board = caller.get("/v1/leaderboard", params={"ranking": ranking})
    assert board.status_code == 200, board.text
    return [(one["rank"], one["team"], one["agent"], one["runs"], one["baseline"]) for one in board.json()["rows"]]


def test_a_challenge_from_its_making_to_its_final_board(stored: Harness) -> None:
    database = stored.services.database
    organiser = stored.caller("lab", Role.ORGANISER)
    ranking = make_challenge(organiser, runs_per_period=2, counts="best")
    ann, bob = admit(stored, organiser, "ann", team="blue"), admit(stored, organiser, "bob", team="blue")
    eve = admit(stored, organiser, "eve")
    for caller, agent in ((ann, "a"), (bob, "b"), (eve, "e"), (organiser, "base")):
        caller.agent(agent)
    assert organiser.post("/v1/challenges/cup/baselines", {"agent": "base"}).status_code == 201
    assert ann.post("/v1/webhooks", {"url": "https://example.org/hook"}).status_code == 201

    runs = {name: enter(caller, agent, ranking)["id"] for name, caller, agent in (("a", ann, "a"), ("b", bob, "b"))}
    assert_problem(ann.post("/v1/evaluations", _order("a", ranking)), 429, "your team has ordered 2 of 2")
    runs |= {"e": enter(eve, "e", ranking)["id"], "base": enter(organiser, "base", ranking)["id"]}
    for name, score in (("a", 60.0), ("b", 90.0), ("e", 30.0), ("base", 50.0)):
        complete(database, runs[name], score)
    late = enter(eve, "e", ranking)["id"]
    expected = [(1, "blue", "b", 2, False), (None, None, "base", 1, True), (2, "eve", "e", 2, False)]
    assert rows(eve, ranking) == expected
    seen = stored.client.get("/v1/challenges/cup").json()
    assert (seen["teams"], seen["my_team"], seen["may_organise"], seen["announcements"]) == (2, None, False, [])
    assert seen["phases"][0]["state"] == "open"

    end(database, ranking)
    complete(database, late, 100.0, finished=now() + timedelta(seconds=1))  # too late
    close_ended(stored.services)
    assert rows(eve, ranking) == expected
    assert_problem(eve.post("/v1/evaluations", _order("e", ranking)), 409, "closed")
    with database.session() as session:
        session.execute(update(Evaluation).where(Evaluation.id == late).values(finished=now() - timedelta(days=9)))
        bodies = [one.body for one in session.scalars(select(Delivery))]
    assert rows(eve, ranking) == rows(stored.client, ranking) == expected
    board = stored.client.get("/v1/leaderboard", params={"ranking": ranking}).json()
    assert board["final"] is True
    assert board["ranking"]["state"] == "final"
    assert [body["phase"] for body in bodies if body["event"] == "phase.final"] == ["final"]
    (news,) = ann.get("/v1/challenges/cup").json()["announcements"]
    assert (news["phase"], news["places"]) == ("final", 3)
    assert [(one["team"], one["score"]) for one in news["winners"]] == [("blue", pytest.approx(90.0))]


def _order(agent: str, ranking: str) -> dict[str, Any]:
    return {"agent": agent, "benchmark": "quickstart", "ranked": True, "ranking": ranking}


def statements_of_list(service: Harness) -> int:
    """Number of queries of the thread that lists the challenges."""
    asked: dict[int, list[str]] = {}

    def note(*given: Any) -> None:
        asked.setdefault(threading.get_ident(), []).append(given[2])

    event.listen(service.services.database.engine, "before_cursor_execute", note)
    assert service.client.get("/v1/challenges").status_code == 200
    event.remove(service.services.database.engine, "before_cursor_execute", note)
    (mine,) = [some for some in asked.values() if any("FROM challenges ORDER BY" in one for one in some)]
    return len(mine)


def test_a_list_of_more_challenges_takes_no_more_queries(service: Harness) -> None:
    organiser, numbers = service.caller("lab", Role.ORGANISER), []
    organiser.agent("base")
    for number in range(4):
        ended = make_challenge(organiser, f"cup-{number}")
        organiser.post(f"/v1/challenges/cup-{number}/baselines", {"agent": "base"})
        end(service.services.database, ended)
        close_ended(service.services)
        numbers.append(statements_of_list(service))
    (last,) = service.client.get("/v1/challenges", params={"after": "cup-2"}).json()["items"]
    assert [one["agent"] for one in last["baselines"]] == ["base"]
    assert [(one["ranking"], one["places"], one["winners"]) for one in last["announcements"]] == [(ended, 0, [])]
    assert len(set(numbers)) == 1


def test_a_run_that_was_ordered_in_time_may_end_within_the_grace(service: Harness) -> None:
    organiser = service.caller("lab", Role.ORGANISER)
    ranking = make_challenge(organiser, grace_s=3600)
    ann = admit(service, organiser, "ann")
    ann.agent("a")
    run = enter(ann, "a", ranking)["id"]
    with service.services.database.session() as session:
        session.execute(update(Ranking).where(Ranking.id == ranking).values(closes=now() - timedelta(minutes=1)))
    assert organiser.get("/v1/challenges/cup").json()["phases"][0]["state"] == "closed"
    complete(service.services.database, run, 70.0)
    assert [row[2] for row in rows(ann, ranking)] == ["a"]


@pytest.mark.parametrize("benchmark", ["parking-simple", "forecast-easy", "dissipation"])
def test_phases_on_benchmarks_of_every_family_become_final(service: Harness, benchmark: str) -> None:
    organiser = service.caller("lab", Role.ORGANISER)
    rankings = make_challenge(organiser, benchmark=benchmark, draw_seeds=None), make_challenge(organiser, "other")
    for ranking in rankings:
        end(service.services.database, ranking)
    close_ended(service.services)
    with service.services.database.session() as session:
        assert all(session.get_one(Ranking, ranking).finalised for ranking in rankings)


def test_a_phase_whose_benchmark_cannot_be_read_keeps_no_other_open(service: Harness) -> None:
    organiser, database = service.caller("lab", Role.ORGANISER), service.services.database
    damaged = make_challenge(organiser, benchmark="parking-simple", draw_seeds=None)
    sound = make_challenge(organiser, "other")
    for ranking in (damaged, sound):
        end(database, ranking)
    with database.session() as session:
        of_damaged = session.get_one(Ranking, damaged).benchmark_sha256
        session.get_one(BenchmarkVersion, of_damaged).document = {"kind": "parking"}
    close_ended(service.services)
    with database.reading() as session:
        finalised = [session.get_one(Ranking, ranking).finalised for ranking in (damaged, sound)]
    assert [one is not None for one in finalised] == [False, True]


def test_only_its_organiser_changes_a_challenge(service: Harness) -> None:
    organiser, rival = service.caller("lab", Role.ORGANISER), service.caller("rival", Role.ORGANISER)
    ranking = make_challenge(organiser)
    others = (rival, service.caller("lab"), service.caller("ann"), service.caller("lab", Role.READER))
    requests: list[tuple[str, str, Any]] = [
        ("PATCH", "/v1/challenges/cup", {"rules": "mine"}),
        ("POST", "/v1/challenges/cup/phases", {"name": "x", "benchmark": "quickstart", "closes": in_days(1)}),
        ("PATCH", f"/v1/challenges/cup/phases/{ranking}", {"closes": in_days(2)}),
        ("DELETE", f"/v1/challenges/cup/phases/{ranking}", None),
        ("POST", "/v1/challenges/cup/invitations", {}),
        ("GET", "/v1/challenges/cup/invitations", None),
        ("DELETE", "/v1/challenges/cup/invitations/in-0", None),
        ("POST", "/v1/challenges/cup/baselines", {"agent": "a"}),
        ("DELETE", "/v1/challenges/cup/baselines/sub-0", None),
    ]
    for method, path, body in requests:
        for caller in others:
            answer = service.client.request(method, path, json=body, headers=caller.headers)
            assert answer.status_code == 403, (method, path, answer.text)
        assert service.client.request(method, path, json=body).status_code == 401
    assert_problem(service.caller("ann").post("/v1/challenges", {"name": "mine", "title": "t"}), 403, "organiser")
    assert service.client.get("/v1/challenges/cup").json()["rules"] == "# Rules\n<b>Drive.</b>"


def test_the_end_of_a_phase_can_only_be_postponed(service: Harness) -> None:
    organiser = service.caller("lab", Role.ORGANISER)
    ranking = make_challenge(organiser, grace_s=60)
    path = f"/v1/challenges/cup/phases/{ranking}"
    assert_problem(organiser.client.patch(path, json={"closes": in_days(0.5)}, headers=organiser.headers), 409)
    moved = organiser.client.patch(path, json={"closes": in_days(3)}, headers=organiser.headers).json()
    assert moved["closes"] > in_days(2.9)
    assert moved["ends"] > moved["closes"]
    end(service.services.database, ranking)
    assert_problem(organiser.client.patch(path, json={"closes": in_days(9)}, headers=organiser.headers), 409)


def test_times_of_any_zone_are_the_same_moments(stored: Harness) -> None:
    organiser = stored.caller("lab", Role.ORGANISER)
    make_challenge(organiser, closes="2031-05-01T12:00:00+02:00", grace_s=3600)
    (phase,) = stored.client.get("/v1/challenges/cup").json()["phases"]
    assert (phase["closes"], phase["ends"]) == ("2031-05-01T10:00:00Z", "2031-05-01T11:00:00Z")


# Invitations


def test_a_code_admits_one_owner_once(stored: Harness) -> None:
    organiser = stored.caller("lab", Role.ORGANISER)
    make_challenge(organiser)
    made = organiser.post("/v1/challenges/cup/invitations", {"note": "for Ann"}).json()
    redeem: dict[str, Any] = {"code": made["code"], "owner": "ann"}
    first = stored.client.post("/v1/invitations/redeem", json=redeem)
    assert first.status_code == 201
    ann = Caller(stored.client, first.json()["token"])
    assert (ann.get("/v1/me").json()["role"], ann.get("/v1/me").json()["owner"]) == ("submitter", "ann")
    assert ann.get("/v1/challenges/cup").json()["my_team"] == "ann"
    assert_problem(stored.client.post("/v1/invitations/redeem", json=redeem | {"owner": "eve"}), 404, "used")
    (listed,) = organiser.get("/v1/challenges/cup/invitations").json()["items"]
    assert (listed["redeemed_by"], listed["note"], "code" in listed) == ("ann", "for Ann", False)
    assert made["code"] not in organiser.get("/v1/challenges/cup/invitations").text


@pytest.mark.parametrize("name", ["ann", "ANN", "lab", "blue"])
def test_a_code_never_opens_the_data_of_an_owner_who_exists(service: Harness, name: str) -> None:
    organiser = service.caller("lab", Role.ORGANISER)
    make_challenge(organiser)
    service.caller("ann")
    admit(service, organiser, "bob", team="blue")
    code = organiser.post("/v1/challenges/cup/invitations", {}).json()["code"]
    answer = service.client.post("/v1/invitations/redeem", json={"code": code, "owner": name})
    assert_problem(answer, 409, "choose another name")
    assert service.client.post("/v1/invitations/redeem", json={"code": code, "owner": "new"}).status_code == 201


def test_codes_that_admit_nobody(service: Harness) -> None:
    organiser, ann = service.caller("lab", Role.ORGANISER), service.caller("ann")
    make_challenge(organiser)

    def code(**order: Any) -> dict[str, Any]:
        made: dict[str, Any] = organiser.post("/v1/challenges/cup/invitations", order).json()
        return made

    revoked, expired, mine, second = code(), code(), code(), code()
    assert organiser.delete(f"/v1/challenges/cup/invitations/{revoked['id']}").status_code == 204
    with service.services.database.session() as session:
        session.get_one(Invitation, expired["id"]).expires = now() - timedelta(seconds=1)
    for one in (revoked["code"], expired["code"], "dohyo_invitation_guess", mine["code"] + "x"):
        assert_problem(ann.post("/v1/invitations/redeem", {"code": one}), 404, "no open invitation")
    assert_problem(organiser.post("/v1/invitations/redeem", {"code": mine["code"]}), 403, "cannot take part")
    assert ann.post("/v1/invitations/redeem", {"code": mine["code"], "team": "red"}).json()["token"] is None
    assert_problem(ann.post("/v1/invitations/redeem", {"code": second["code"]}), 409, "takes part")
    for role in (Role.READER, Role.WORKER, Role.ADMIN):
        other = service.caller("eve", role)
        assert_problem(other.post("/v1/invitations/redeem", {"code": second["code"]}), 403, f"yours is {role}")
    bob = {"code": second["code"], "owner": "bob", "team": "RED"}
    assert_problem(service.client.post("/v1/invitations/redeem", json=bob), 409, "team 'RED' exists")


def test_no_team_has_the_name_of_another_owner_or_looks_like_another_team(stored: Harness) -> None:
    organiser, ann = stored.caller("lab", Role.ORGANISER), stored.caller("ann")
    make_challenge(organiser)
    stored.caller("bob")

    def redeemed(team: str, **owner: str) -> httpx.Response:
        code = organiser.post("/v1/challenges/cup/invitations", {}).json()["code"]
        headers = {} if owner else ann.headers
        return stored.client.post("/v1/invitations/redeem", json={"code": code, "team": team} | owner, headers=headers)

    for taken in ("lab", "Bob", "ANN"):
        assert_problem(redeemed(taken, owner="eve"), 409, f"an owner has the name '{taken}'")
    assert_problem(redeemed("lab"), 409, "an owner has the name 'lab'")
    assert redeemed("blue  x").status_code == 422
    assert redeemed("blue x", owner="eve").json()["team"] == "blue x"
    assert redeemed("Ann").json()["team"] == "Ann"
    assert redeemed("Mia", owner="mia").json()["team"] == "Mia"
    assert redeemed("red", owner="red-owner").json()["team"] == "red"
    assert_problem(redeemed("x", owner="RED"), 409, "a team has the name 'RED'")


def test_phases_do_not_differ_in_case_alone(stored: Harness) -> None:
    organiser = stored.caller("lab", Role.ORGANISER)
    make_challenge(organiser)
    order = {"name": "FINAL", "benchmark": "quickstart", "closes": in_days(1)}
    assert_problem(organiser.post("/v1/challenges/cup/phases", order), 409, "has a phase 'final'")


def test_nobody_makes_the_team_that_an_open_invitation_names(service: Harness) -> None:
    """The invited one would join it, and a team has one place and few runs."""
    organiser = service.caller("lab", Role.ORGANISER)
    make_challenge(organiser)
    made = [organiser.post("/v1/challenges/cup/invitations", order).json() for order in ({"team": "Blue"}, {}, {})]
    for_ann, for_mallory, for_bob = (one["code"] for one in made)

    def redeemed(code: str, owner: str, **order: str) -> httpx.Response:
        return service.client.post("/v1/invitations/redeem", json={"code": code, "owner": owner, **order})

    assert_problem(redeemed(for_mallory, "mallory", team="BLUE"), 409, "team 'BLUE' exists")
    assert_problem(redeemed(for_mallory, "blue"), 409, "a team has the name 'blue'")
    assert_problem(redeemed(for_mallory, "blue", team="red"), 409, "a team has the name 'blue'")
    assert redeemed(for_mallory, "mallory", team="red").json()["team"] == "red"
    assert organiser.delete(f"/v1/challenges/cup/invitations/{made[0]['id']}").status_code == 204
    assert redeemed(for_bob, "bob", team="blue").json()["team"] == "blue"
    assert_problem(redeemed(for_ann, "ann"), 404, "no open invitation")


def test_an_owner_may_have_the_name_of_the_team_that_the_own_invitation_names(service: Harness) -> None:
    organiser = service.caller("lab", Role.ORGANISER)
    for challenge in ("cup", "other"):
        make_challenge(organiser, challenge)

    def code(challenge: str) -> str:
        made = organiser.post(f"/v1/challenges/{challenge}/invitations", {"team": "Ann"}).json()
        return str(made["code"])

    codes, elsewhere = [code("cup") for _ in range(2)], code("other")
    first: dict[str, Any] = {"code": codes[0], "owner": "ann"}
    assert_problem(service.client.post("/v1/invitations/redeem", json=first | {"code": elsewhere}), 409, "a team has")
    assert_problem(service.client.post("/v1/invitations/redeem", json=first), 409, "a team has")
    (other,) = organiser.get("/v1/challenges/other/invitations").json()["items"]
    organiser.delete(f"/v1/challenges/other/invitations/{other['id']}")
    assert service.client.post("/v1/invitations/redeem", json=first).json()["team"] == "Ann"
    second = service.client.post("/v1/invitations/redeem", json={"code": codes[1], "owner": "bob"})
    assert second.json()["team"] == "Ann"


# Who may enter


def test_what_may_not_enter_a_phase(service: Harness) -> None:
    organiser = service.caller("lab", Role.ORGANISER)
    ranking = make_challenge(organiser, verified_only=True, track="sensors")
    planned = organiser.post(
        "/v1/challenges/cup/phases",
        {"name": "later", "benchmark": "quickstart", "opens": in_days(1), "closes": in_days(2)},
    ).json()["id"]
    ann, stranger = admit(service, organiser, "ann"), service.caller("stranger")
    ann.agent("a")
    stranger.agent("s")
    organiser.agent("own")
    assert "remote" in enter(ann, "a", ranking, 403)["detail"] or "track" in enter(ann, "a", ranking, 403)["detail"]
    assert re.search(r"opens at .* \d\d:\d\d:\d\d UTC", enter(ann, "a", planned, 409)["detail"])
    open_phase = organiser.post(
        "/v1/challenges/cup/phases", {"name": "open", "benchmark": "quickstart", "closes": in_days(2)}
    ).json()["id"]
    assert "no team" in enter(stranger, "s", open_phase, 403)["detail"]
    assert "no team" in enter(organiser, "own", open_phase, 403)["detail"]  # not a baseline
    assert_problem(ann.post("/v1/evaluations", _order("a", open_phase) | {"benchmark": "val14"}), 422, "quickstart")
    assert_problem(ann.post("/v1/evaluations", _order("a", "rk-none")), 404)
    assert_problem(organiser.post("/v1/challenges/cup/baselines", {"agent": "a"}), 404)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"secret": True, "draw_seeds": None}, ["body.secret"]),
        ({"seeds": [1], "draw_seeds": 2}, ["body.draw_seeds"]),
        ({"seeds": [1, 7, 7], "draw_seeds": None}, ["a seed comes twice: 7"]),
        ({"opens": "2030-01-02T00:00:00Z", "closes": "2030-01-01T00:00:00Z"}, ["body.closes"]),
        ({"closes": "2020-01-01T00:00:00Z"}, ["closes"]),
        ({"closes": "2030-01-01T00:00:00"}, ["body.closes"]),
        ({"closes": "9999-12-31T23:59:59Z", "grace_s": 86400}, ["body.closes"]),
        ({"runs_per_period": 0}, ["body.runs_per_period"]),
        ({"act_deadline_s": 0.09}, ["body.act_deadline_s"]),
        ({"period_s": 59.0}, ["body.period_s"]),
        ({"board": "nobody"}, ["body.board"]),
        ({"benchmark": "parking-complex", "draw_seeds": 5}, ["body.draw_seeds: expected at least 6 seeds"]),
        ({"benchmark": "dissipation", "draw_seeds": None, "seeds": [1, 2]}, ["body.seeds: expected at least 6 seeds"]),
        ({"benchmark": "forecast-hard", "draw_seeds": None}, ["body.seeds: expected at least 2 seeds"]),
        ({"draw_seeds": None, "seeds": [9, 1, 0], "secret": True}, ["body.seeds: expected none of", "got 0, 1"]),
        ({"benchmark": "dissipation", "draw_seeds": 6, "track": "sensors"}, ["body.track: expected 'privileged'"]),
        ({"benchmark": "forecast-easy", "track": "privileged"}, ["body.track: expected 'sensors'"]),
        ({"benchmark": "parking-simple", "draw_seeds": 6, "track": "map"}, ["body.track", "'sensors' or 'privileged'"]),
        *(
            (
                {"benchmark": name, "draw_seeds": 6, "slow_policy": "realtime"},
                [f"body.slow_policy: expected 'wait' on '{name}'"],
            )
            for name in ("dissipation", "forecast-easy", "parking-simple")
        ),
        ({"color": "red"}, ["body.color"]),
    ],
)
def test_an_impossible_phase_is_refused_with_its_place(
    service: Harness, change: dict[str, Any], says: list[str]
) -> None:
    organiser = service.caller("lab", Role.ORGANISER)
    assert organiser.post("/v1/challenges", {"name": "cup", "title": "t"}).status_code == 201
    order = {"name": "p", "benchmark": "quickstart", "draw_seeds": 1, "closes": in_days(1)} | change
    assert_problem(organiser.post("/v1/challenges/cup/phases", order), 422, *says)


@pytest.mark.parametrize(
    ("benchmark", "track"),
    [("dissipation", "privileged"), ("parking-simple", "privileged"), ("forecast-easy", "sensors")],
)
def test_a_phase_on_the_track_of_its_agents_has_six_drives(service: Harness, benchmark: str, track: str) -> None:
    make_challenge(service.caller("lab", Role.ORGANISER), benchmark=benchmark, draw_seeds=6, track=track, secret=True)


def test_a_phase_can_be_deleted_until_a_run_was_ordered(stored: Harness) -> None:
    organiser = stored.caller("lab", Role.ORGANISER)
    ranking, other = make_challenge(organiser), make_challenge(organiser, "other")
    ann = admit(stored, organiser, "ann")
    ann.agent("a")
    assert_problem(organiser.delete(f"/v1/challenges/cup/phases/{other}"), 404, "has no phase")
    assert organiser.delete(f"/v1/challenges/other/phases/{other}").status_code == 204
    assert organiser.get("/v1/challenges/other").json()["phases"] == []
    run = enter(ann, "a", ranking)["id"]
    assert ann.post(f"/v1/evaluations/{run}/cancel").status_code in (200, 202, 204)
    assert_problem(organiser.delete(f"/v1/challenges/cup/phases/{ranking}"), 409, "only a phase without runs")


def test_a_run_that_ended_in_time_counts_though_it_is_stored_after_the_end(stored: Harness) -> None:
    database = stored.services.database
    organiser = stored.caller("lab", Role.ORGANISER)
    ranking = make_challenge(organiser)
    ann = admit(stored, organiser, "ann")
    ann.agent("a")
    run = enter(ann, "a", ranking)["id"]
    complete(database, run, 50.0)
    with database.session() as session:
        driving = {"status": EvaluationStatus.RUNNING, "finished": None}
        session.execute(update(Evaluation).where(Evaluation.id == run).values(driving))
    end(database, ranking, ago=timedelta(seconds=-5))  # so long a slow machine may take to settle the run
    closing = threading.Thread(target=close_ended, args=(stored.services,))
    with database.session() as session:
        queue.settle(session, run)
        session.flush()
        wait_until(session.get_one(Ranking, ranking).ended, "the phase does not end")
        closing.start()
        closing.join(0.5)  # it waits for this transaction
    closing.join()
    assert [one[1] for one in rows(ann, ranking)] == ["ann"]
