"""Orders of mixed runs: what is taken, what is refused with its place, and what keeps the submissions of the egos."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pytest
from sqlalchemy import select

from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.evaluation.families import PARKING_CONTROL
from dohyo.service.accounts.model import Role
from dohyo.service.evaluations.model import EpisodeStatus, EvaluationEgo, EvaluationStatus
from dohyo.service.submissions.model import AgentKind
from dohyo.service.submissions.queries import add_agent, add_submission
from tests.evaluation.builders import AGENT
from tests.service.harness import Caller, Harness, assert_problem, finish, running

EGOS = load_benchmark("fleet").shared_egos
FLEET = {"agent": "a", "benchmark": "fleet", "seeds": [0]}


def submit(service: Harness, name: str, owner: str = "team", **changes: Any) -> None:
    """An agent with one built-in submission, which no process tries first."""
    with service.services.database.session() as session:
        agent = add_agent(session, name, owner, "")
        add_submission(session, agent, AgentKind.BUILTIN, AGENT.model_copy(update={"name": name} | changes))


def order(team: Caller, egos: Mapping[str, Any], **changes: Any) -> Any:
    return team.post("/v1/evaluations", FLEET | {"egos": egos} | changes)


def test_a_mixed_run_names_the_agent_of_each_ego_and_is_practice(stored: Harness) -> None:
    team = stored.caller("team")
    submit(stored, "a")
    submit(stored, "b", track="map")
    egos, key = {"west-1": {"agent": "b"}, "yard": {"agent": "b", "version": 1}}, {"idempotency-key": "k"}
    made = team.post("/v1/evaluations", FLEET | {"egos": egos}, headers=key)
    assert made.status_code == 201, made.text
    mixed = made.json()
    assert (mixed["agent"], mixed["ranking"], mixed["progress"]["queued"]) == ("a", None, 1)
    assert {ego: (one["agent"], one["version"], one["track"]) for ego, one in mixed["egos"].items()} == {
        "west-1": ("b", 1, "map"),
        "yard": ("b", 1, "map"),
    }
    assert team.post("/v1/evaluations", FLEET | {"egos": egos}, headers=key).json()["id"] == mixed["id"]
    assert_problem(team.post("/v1/evaluations", FLEET, headers=key), 422, "used for another request")
    assert [one["id"] for one in team.get("/v1/evaluations?agent=b").json()["items"]] == [mixed["id"]]
    assert team.get("/v1/benchmarks/fleet").json()["egos"] == list(EGOS)
    manifest = team.get(f"/v1/evaluations/{mixed['id']}/manifest").json()
    assert (manifest["agent"]["name"], sorted(manifest["others"])) == ("b", sorted(set(EGOS) - set(egos)))
    assert manifest["seeds"] == mixed["seeds"]

    alone = order(team, {"west-1": {"agent": "a"}}).json()
    assert alone["egos"] == {}, "an ego that is given to the run's own agent is no mix"


def test_a_submission_stays_as_long_as_a_mixed_run_names_it(stored: Harness) -> None:
    team, database = stored.caller("team"), stored.services.database
    submit(stored, "a")
    submit(stored, "b")
    mixed = order(team, {"west-1": {"agent": "b"}}).json()["id"]
    assert_problem(team.delete("/v1/agents/b/submissions/1"), 409, mixed)
    cancelled = team.post(f"/v1/evaluations/{mixed}/cancel").json()
    assert (cancelled["status"], list(cancelled["egos"])) == ("cancelled", ["west-1"])
    resumed = team.post(f"/v1/evaluations/{mixed}/resume").json()
    assert (resumed["status"], list(resumed["egos"])) == ("queued", ["west-1"])
    finish(database, mixed, EvaluationStatus.DONE, EpisodeStatus.DONE)

    other = order(team, {"west-1": {"agent": "a"}}, agent="b").json()["id"]
    assert_problem(team.delete(f"/v1/evaluations/{mixed}"), 409, other)  # it may make the same records
    finish(database, other, EvaluationStatus.DONE, EpisodeStatus.DONE)
    assert team.delete(f"/v1/evaluations/{mixed}").status_code == 204
    assert team.delete(f"/v1/evaluations/{other}").status_code == 204
    with database.reading() as session:
        assert session.scalars(select(EvaluationEgo)).all() == []
    assert team.delete("/v1/agents/b/submissions/1").status_code == 204


def test_what_compares_runs_of_one_agent_refuses_a_mixed_one(service: Harness) -> None:
    team = service.caller("team")
    submit(service, "a")
    submit(service, "b")
    ids = [order(team, {"west-1": {"agent": "b"}}).json()["id"], order(team, {}).json()["id"]]
    compared = team.get("/v1/comparison", params={"evaluation": ids})
    assert_problem(compared, 422, f"expected runs of one agent, and evaluation '{ids[0]}' is a mixed run")
    assert_problem(team.post("/v1/rescore", {"evaluation": ids[0]}), 409, "is a mixed run", "dohyo score")


@pytest.mark.parametrize(
    ("changes", "place", "words"),
    [
        ({"egos": {"middle": {"agent": "b"}}}, "egos.middle", "expected an ego of every scenario of 'fleet': west-1"),
        ({"egos": {"*": {"agent": "b"}}}, "egos.*", "expected an ego of every scenario"),
        ({"egos": {"west-1": {"agent": "none"}}}, "egos.west-1.agent", "an agent of your own, got 'none'"),
        ({"egos": {"west-1": {"agent": "foreign"}}}, "egos.west-1.agent", "an agent of your own, got 'foreign'"),
        ({"egos": {"west-1": {"agent": "b", "version": 2}}}, "egos.west-1.version", "expected version 2"),
        ({"egos": {"west-1": {"agent": "empty"}}}, "egos.west-1.version", "expected a submission"),
        ({"egos": {"west-1": {"agent": "remote"}}}, "egos.west-1.agent", "a world"),
        ({"egos": {"west-1": {"agent": "b"}}, "agent": "remote"}, "agent", "a world"),
        ({"egos": {"west-1": {"agent": "parker"}}}, "egos.west-1.agent", "expected agents that drive cars"),
        ({"egos": {"ego": {"agent": "b"}}, "benchmark": "quickstart"}, "egos", "egos drive together"),
        ({"egos": {ego: {"agent": "b"} for ego in EGOS}}, "egos", "left to agent 'a'"),
        ({"egos": {"west-1": {"agent": "b"}}, "ranked": True, "seeds": None}, "egos", "mixed runs are practice"),
        ({"egos": {"west-1": "b"}}, "egos.west-1", "valid dictionary"),
        ({"egos": {"west-1": {"agent": "b", "seed": 1}}}, "egos.west-1.seed", "not permitted"),
        ({"egos": {"": {"agent": "b"}}}, "egos.", "at least 1"),
        ({"egos": {f"e{n}": {"agent": "b"} for n in range(101)}}, "egos", "at most 100"),
        ({"egos": ["west-1"]}, "egos", "valid dictionary"),
        ({"egos": None}, "egos", "valid dictionary"),
    ],
)
def test_a_mix_that_cannot_be_is_refused_with_its_place(
    changes: dict[str, Any], place: str, words: str, mixing: Caller
) -> None:
    refused = mixing.post("/v1/evaluations", FLEET | changes)
    assert_problem(refused, 422, words)
    assert [fault["where"].startswith(f"body.{place}") for fault in refused.json()["errors"]] == [True]
    assert mixing.get("/v1/evaluations").json()["items"] == []


@pytest.fixture(scope="module")
def mixing(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """An owner with agents of all sorts, at a service where others have some too."""
    with running(tmp_path_factory.mktemp("mixing") / "data") as service:
        team = service.caller("team")
        submit(service, "a")
        submit(service, "b")
        submit(service, "parker", control=PARKING_CONTROL)
        submit(service, "foreign", owner="somebody-else")
        team.agent("remote")
        assert team.post("/v1/agents", {"name": "empty"}).status_code == 201
        yield team


def test_an_administrator_mixes_agents_of_several_owners(service: Harness) -> None:
    root = service.caller("root", Role.ADMIN)
    submit(service, "a", owner="ann")
    submit(service, "b", owner="bob")
    assert order(root, {"west-1": {"agent": "b"}}).json()["egos"]["west-1"]["agent"] == "b"
