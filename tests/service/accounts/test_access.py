from __future__ import annotations

import json
import logging
from datetime import datetime, timedelta

import pytest

from dohyo.service.accounts import routes
from dohyo.service.accounts.model import Role
from tests.service.harness import PASSWORD_OF_NOBODY, Caller, Harness, assert_problem


@pytest.mark.parametrize(
    "header",
    [
        f"Bearer {PASSWORD_OF_NOBODY}",
        "Bearer ",
        "Bearer",
        "Basic YWRtaW46YWRtaW4=",
        "Bearer " + "x" * 5000,
        "Bearer \xe9\xff",
        "Bearer ' OR 1=1 --",
    ],
)
def test_a_wrong_token_is_refused_even_where_none_is_needed(service: Harness, header: str) -> None:
    for path in ("/v1/benchmarks", "/v1/me", "/v1/evaluations"):
        answer = service.client.get(path, headers={"authorization": header.encode("latin-1")})
        assert_problem(answer, 401)
        assert answer.headers["www-authenticate"] == "Bearer"


def test_expired_and_revoked_tokens_are_refused_in_the_same_words(service: Harness) -> None:
    admin = service.caller("root", Role.ADMIN)
    expired = Caller(service.client, service.token("team", expires_in=timedelta(seconds=-1)))
    revoked = service.caller("team")
    assert revoked.get("/v1/me").status_code == 200
    identifier = revoked.get("/v1/me").json()["token"]
    assert admin.delete(f"/v1/tokens/{identifier}").status_code == 204
    unknown = Caller(service.client, PASSWORD_OF_NOBODY)
    answers = [caller.get("/v1/me") for caller in (expired, revoked, unknown)]
    assert [answer.status_code for answer in answers] == [401, 401, 401]
    assert len({answer.text for answer in answers}) == 1


@pytest.mark.parametrize(
    ("role", "allowed"),
    [
        (Role.ADMIN, {"read", "submit", "tokens"}),
        (Role.SUBMITTER, {"read", "submit"}),
        (Role.WORKER, {"read"}),
        (Role.READER, {"read"}),
    ],
)
def test_what_each_role_may(service: Harness, role: Role, allowed: set[str]) -> None:
    caller = service.caller("team", role)
    answers = {
        "read": caller.get("/v1/evaluations"),
        "submit": caller.post("/v1/agents", {"name": "mine"}),
        "tokens": caller.post("/v1/tokens", {"owner": "another", "role": "reader"}),
    }
    assert {name for name, answer in answers.items() if answer.status_code < 400} == allowed
    for name in answers.keys() - allowed:
        assert_problem(answers[name], 403)


def test_an_owner_makes_lists_and_revokes_tokens_of_its_own(service: Harness) -> None:
    ann = Caller(service.client, service.token("ann", Role.SUBMITTER, expires_in=timedelta(days=2)))
    bob = service.caller("bob", Role.SUBMITTER)
    made = ann.post("/v1/tokens", {"role": "worker", "expires_in_days": 300}).json()
    worker = Caller(service.client, made["token"])
    assert (worker.get("/v1/me").json()["owner"], made["role"]) == ("ann", "worker")
    expiry = {one["id"]: datetime.fromisoformat(one["expires"]) for one in ann.get("/v1/tokens").json()["items"]}
    own = expiry[ann.get("/v1/me").json()["token"]]
    assert expiry[made["id"]] - own < timedelta(seconds=1)  # not later than the token that made it, but for rounding
    assert made["id"] in expiry
    assert made["id"] not in [one["id"] for one in bob.get("/v1/tokens").json()["items"]]
    for order in ({"role": "admin"}, {"owner": "bob", "role": "reader"}):
        assert_problem(ann.post("/v1/tokens", order), 403)
    assert_problem(worker.post("/v1/tokens", {"role": "submitter"}), 403)
    assert_problem(worker.delete(f"/v1/tokens/{ann.get('/v1/me').json()['token']}"), 403)
    assert_problem(bob.delete(f"/v1/tokens/{made['id']}"), 404)
    assert ann.delete(f"/v1/tokens/{made['id']}").status_code == 204
    assert worker.get("/v1/me").status_code == 401


def test_tokens_made_and_revoked_without_end_leave_no_more_rows_than_the_limits(
    stored: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(routes, "ENDED_PER_OWNER", 3)
    ann, bob = stored.caller("ann", Role.SUBMITTER), stored.caller("bob", Role.SUBMITTER)
    of_bob = bob.post("/v1/tokens", {"role": "worker"}).json()["id"]
    bob.delete(f"/v1/tokens/{of_bob}")
    own = ann.get("/v1/me").json()["token"]
    expired = Caller(stored.client, stored.token("ann", expires_in=timedelta(seconds=-1)))
    revoked = []
    for _ in range(6):
        made = ann.post("/v1/tokens", {"role": "worker"}).json()
        assert ann.delete(f"/v1/tokens/{made['id']}").status_code == 204
        revoked.append((made["id"], Caller(stored.client, made["token"])))
    last = ann.post("/v1/tokens", {"role": "worker"}).json()["id"]
    listed = {one["id"] for one in ann.get("/v1/tokens").json()["items"]}
    assert listed == {own, last, *(identifier for identifier, _ in revoked[-3:])}
    assert {caller.get("/v1/me").status_code for caller in (expired, *(one for _, one in revoked))} == {401}
    assert of_bob in {one["id"] for one in bob.get("/v1/tokens").json()["items"]}


def test_administrators_make_and_list_tokens_of_all_owners(service: Harness) -> None:
    admin = service.caller("root", Role.ADMIN)
    made = admin.post("/v1/tokens", {"owner": "team-blue", "role": "submitter", "expires_in_days": 2})
    assert made.status_code == 201
    secret = made.json()["token"]
    assert Caller(service.client, secret).get("/v1/me").json()["owner"] == "team-blue"
    listed = admin.get("/v1/tokens?limit=500")
    assert secret not in listed.text
    assert made.json()["id"] in [one["id"] for one in listed.json()["items"]]
    assert_problem(Caller(service.client, secret).post("/v1/tokens", {"owner": "x", "role": "admin"}), 403)
    assert_problem(admin.delete("/v1/tokens/tok-none"), 404)


@pytest.mark.parametrize(
    "order",
    [
        {"owner": "", "role": "reader"},
        {"owner": "a" * 101, "role": "reader"},
        {"owner": "../x", "role": "reader"},
        {"owner": "x\x00", "role": "reader"},
        {"owner": "x", "role": "god"},
        {"owner": "x", "role": "reader", "expires_in_days": -1},
        {"owner": "x", "role": "reader", "expires_in_days": 1e300},
        {"owner": "x", "role": "reader", "sha256": "0" * 64},
        [],
        "text",
        None,
    ],
)
def test_impossible_tokens(service: Harness, order: object) -> None:
    assert_problem(service.caller("root", Role.ADMIN).post("/v1/tokens", order), 422)


def test_pages_go_through_everything_once(service: Harness) -> None:
    admin = service.caller("root", Role.ADMIN)
    for number in range(6):
        service.token(f"team-{number}")
    seen, after = [], None
    while True:
        page = admin.get("/v1/tokens", params={"limit": 3} | ({"after": after} if after else {})).json()
        seen += [one["id"] for one in page["items"]]
        after = page["next"]
        if after is None:
            break
    assert len(seen) == len(set(seen)) == 7


def test_without_a_token_a_private_service_tells_nothing(private: Harness) -> None:
    for path in ("/v1/benchmarks", "/v1/networks", "/v1/agents", "/v1/evaluations", "/v1/observations", "/v1/me"):
        assert_problem(private.client.get(path), 401)
    assert private.client.get("/health/live").status_code == 200


def test_other_owners_things_do_not_exist_on_a_private_service(private: Harness) -> None:
    blue, red = private.caller("blue"), private.caller("red")
    blue.agent("secret-agent")
    evaluation = blue.evaluation("secret-agent")
    admin = private.caller("root", Role.ADMIN)
    for path in (
        "/v1/agents/secret-agent",
        "/v1/agents/secret-agent/submissions",
        f"/v1/evaluations/{evaluation}",
        f"/v1/evaluations/{evaluation}/episodes",
    ):
        assert blue.get(path).status_code == 200
        assert admin.get(path).status_code == 200
        hidden = red.get(path)
        missing = red.get(path.replace("secret-agent", "no-agent").replace(evaluation, "ev-none"))
        assert_problem(hidden, 404)
        assert (
            hidden.json()["detail"].replace("secret-agent", "no-agent").replace(evaluation, "ev-none")
            == (missing.json()["detail"])
        )
    for path in (f"/v1/evaluations/{evaluation}/progress", f"/v1/evaluations/{evaluation}/metrics"):
        assert_problem(red.get(path), 404)
    for path in (f"/v1/evaluations/{evaluation}/cancel", f"/v1/evaluations/{evaluation}/resume"):
        assert_problem(red.post(path), 404)
    assert_problem(red.post("/v1/agents/secret-agent/submissions", {"kind": "remote"}), 404)
    assert_problem(red.post("/v1/evaluations", {"agent": "secret-agent", "benchmark": "quickstart"}), 404)
    assert red.get("/v1/agents").json()["items"] == []
    assert red.get("/v1/evaluations").json()["items"] == []


def test_on_a_public_service_others_read_but_change_nothing(service: Harness) -> None:
    blue, red = service.caller("blue"), service.caller("red")
    blue.agent("blue-agent")
    evaluation = blue.evaluation("blue-agent")
    assert service.client.get(f"/v1/evaluations/{evaluation}").status_code == 200
    for path, body in (
        (f"/v1/evaluations/{evaluation}/cancel", None),
        (f"/v1/evaluations/{evaluation}/resume", None),
        ("/v1/agents/blue-agent/submissions", {"kind": "remote"}),
        ("/v1/evaluations", {"agent": "blue-agent", "benchmark": "quickstart"}),
    ):
        assert_problem(red.post(path, body), 403, "another owner's")
    assert service.scheduler.calls == ["start", "wake"]


def test_webhooks_of_others_do_not_exist(service: Harness) -> None:
    blue, red = service.caller("blue"), service.caller("red")
    made = blue.post("/v1/webhooks", {"url": "https://example.org/hook"}).json()
    assert red.get("/v1/webhooks").json()["items"] == []
    assert_problem(red.delete(f"/v1/webhooks/{made['id']}"), 404)
    assert made["secret"] not in blue.get("/v1/webhooks").text
    assert blue.delete(f"/v1/webhooks/{made['id']}").status_code == 204
    assert blue.get("/v1/webhooks").json()["items"] == []


def test_nothing_secret_is_logged(service: Harness, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.DEBUG):
        admin = service.caller("root", Role.ADMIN)
        made = admin.post("/v1/tokens", {"owner": "team", "role": "reader"}).json()
        Caller(service.client, made["token"]).get("/v1/me?token=" + made["token"])
        Caller(service.client, PASSWORD_OF_NOBODY).get("/v1/me")
    lines = [json.dumps(vars(record), default=str) for record in caplog.records if record.name.startswith("dohyo")]
    requests = [line for line in lines if "/v1/me" in line]
    assert len(requests) == 2
    for secret in (made["token"], PASSWORD_OF_NOBODY, admin.headers["authorization"][7:]):
        assert not [line for line in lines if secret in line]


def test_a_revoked_token_ends_at_once_although_it_was_used(service: Harness) -> None:
    admin, team = service.caller("root", Role.ADMIN), service.caller("team")
    identifier = team.get("/v1/me").json()["token"]
    admin.delete(f"/v1/tokens/{identifier}")
    assert_problem(team.get("/v1/evaluations"), 401)


def test_a_cookie_reads_but_never_writes(service: Harness) -> None:
    token = service.token("team")
    service.client.cookies.set("dohyo_token", token)
    assert service.client.get("/v1/me").status_code == 200
    assert_problem(service.client.post("/v1/agents", json={"name": "forged"}), 401)
    service.client.cookies.clear()


def test_cancel_is_told_to_the_scheduler_and_can_be_repeated(service: Harness) -> None:
    team = service.caller("team")
    team.agent("a")
    evaluation = team.evaluation("a")
    for _ in range(2):
        answer = team.post(f"/v1/evaluations/{evaluation}/cancel")
        assert (answer.status_code, answer.json()["status"]) == (200, "cancelled")
    assert service.scheduler.calls.count(f"cancel {evaluation}") == 1


def test_health_knows_when_the_database_is_gone(service: Harness) -> None:
    assert service.client.get("/health/ready").json()["status"] == "ready"
    service.services.draining = True
    assert_problem(service.client.get("/health/ready"), 503)
    assert_problem(service.caller("t").post("/v1/evaluations", {"agent": "a", "benchmark": "quickstart"}), 503)
    service.services.draining = False
