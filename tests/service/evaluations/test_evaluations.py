from __future__ import annotations

import json
import threading
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import select

from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.service.accounts.model import Role
from dohyo.service.episodes.readers import evaluation_for
from dohyo.service.evaluations import metrics_routes
from dohyo.service.evaluations.model import EpisodeStatus, Evaluation, EvaluationStatus
from dohyo.service.evaluations.queries import list_episodes
from dohyo.service.storage.deletion import delete_evaluation
from dohyo.service.submissions import installed
from dohyo.service.submissions.model import Agent, Submission
from tests.service.harness import Caller, Harness, assert_problem, finish, running


def test_one_episode_per_scenario_in_the_benchmarks_order(stored: Harness) -> None:
    team = stored.caller("team")
    team.agent("a")
    made = team.post("/v1/evaluations", {"agent": "a", "benchmark": "quickstart", "seeds": [7, 3]}).json()
    scenarios = load_benchmark("quickstart").scenarios([7, 3])
    assert made["progress"] == {
        "total": len(scenarios),
        "queued": len(scenarios),
        "done": 0,
        "running": 0,
        "lost": 0,
        "cancelled": 0,
    }
    listed = team.get(f"/v1/evaluations/{made['id']}/episodes").json()["items"]
    assert [(one["scenario"], one["seed"], one["cell"]) for one in listed] == [
        (scenario.name, scenario.seed, scenario.cell) for scenario in scenarios
    ]
    assert [one["position"] for one in listed] == list(range(len(scenarios)))
    assert made["benchmark_version"] == load_benchmark("quickstart").sha256
    assert stored.scheduler.calls == ["start", "wake"]


def test_episodes_come_in_pages(stored: Harness) -> None:
    team = stored.caller("team")
    team.agent("a")
    path = f"/v1/evaluations/{team.evaluation('a')}/episodes"
    whole = team.get(path).json()["items"]
    first = team.get(f"{path}?limit=4").json()
    second = team.get(f"{path}?limit=500&after={first['next']}").json()
    assert first["items"] + second["items"] == whole
    assert second["next"] is None


def test_lists_are_newest_first_filtered_and_paged(stored: Harness) -> None:
    team = stored.caller("team")
    team.agent("a")
    team.agent("b")
    ids = [team.evaluation(agent, seeds=[0]) for agent in ("a", "b", "a", "a", "b")]
    finish(stored.services.database, ids[2], EvaluationStatus.DONE, EpisodeStatus.DONE)

    def listed(query: str) -> list[str]:
        return [one["id"] for one in team.get(f"/v1/evaluations{query}").json()["items"]]

    assert listed("") == ids[::-1]
    assert listed("?agent=b") == [ids[4], ids[1]]
    assert listed("?status=done") == [ids[2]]
    assert listed("?benchmark=quickstart&agent=a&status=queued") == [ids[3], ids[0]]
    assert listed("?benchmark=nothing") == listed("?after=ev-none") == []
    seen, after = [], ""
    while after is not None:
        page = team.get(f"/v1/evaluations?limit=2{f'&after={after}' if after else ''}").json()
        seen += [one["id"] for one in page["items"]]
        after = page["next"]
    assert seen == ids[::-1]


@pytest.mark.parametrize(
    ("change", "status"),
    [
        ({"agent": "nobody"}, 404),
        ({"agent": "empty"}, 404),
        ({"version": 2}, 404),
        ({"benchmark": "quickstat"}, 404),
        ({"benchmark": "../benchmarks/quickstart"}, 404),
        ({"benchmark": "/etc/passwd.toml"}, 404),
        ({"benchmark": "quickstart\x00"}, 422),
        ({"only": ["through-east"]}, 422),  # evaluations are of whole benchmarks, since they are ranked
        ({"sample": 2}, 422),
        ({"seeds": []}, 422),
        ({"seeds": [-1]}, 422),
        ({"seeds": [2**31]}, 422),
        ({"seeds": [0.5]}, 422),
        ({"seeds": list(range(101))}, 422),
        ({"version": 0}, 422),
        ({"version": 10**30}, 422),
        ({"slow_policy": "never"}, 422),
        ({"act_deadline_s": 0}, 422),
        ({"act_deadline_s": 0.09}, 422),
        ({"act_deadline_s": 1e9}, 422),
        ({"rules": "3.0"}, 422),
    ],
)
def test_impossible_orders_leave_nothing(stored: Harness, change: dict[str, object], status: int) -> None:
    team = stored.caller("team")
    team.agent("a")
    team.post("/v1/agents", {"name": "empty"})
    answer = team.post("/v1/evaluations", {"agent": "a", "benchmark": "quickstart", **change})
    assert_problem(answer, status)
    assert team.get("/v1/evaluations").json()["items"] == []
    assert stored.scheduler.calls == ["start"]


@pytest.mark.parametrize("benchmark", ["dissipation", "forecast-hard", "parking-three"])
def test_only_drives_on_roads_go_on_without_their_agent(stored: Harness, benchmark: str) -> None:
    """Other records do not tell of late decisions, which would be in their scores."""
    team = stored.caller("team")
    team.agent("a")
    order = {"agent": "a", "benchmark": benchmark, "slow_policy": "realtime"}
    assert_problem(
        team.post("/v1/evaluations", order), 422, f"body.slow_policy: expected 'wait' on '{benchmark}', got 'realtime'"
    )
    assert team.post("/v1/evaluations", order | {"benchmark": "quickstart"}).json()["slow_policy"] == "realtime"


def test_a_near_miss_is_named(service: Harness) -> None:
    team = service.caller("team")
    team.agent("a")
    answer = team.post("/v1/evaluations", {"agent": "a", "benchmark": "quickstat"})
    assert_problem(answer, 404, "did you mean 'quickstart'")


def test_the_same_key_makes_one_evaluation(stored: Harness) -> None:
    team, other = stored.caller("team"), stored.caller("other")
    team.agent("a")
    other.agent("b")
    order, key = {"agent": "a", "benchmark": "quickstart"}, {"idempotency-key": "k-1"}
    first = team.post("/v1/evaluations", order, headers=key)
    again = team.post("/v1/evaluations", order, headers=key)
    assert first.status_code == again.status_code == 201
    assert first.json() == again.json()
    assert len(team.get("/v1/evaluations").json()["items"]) == 1
    assert_problem(team.post("/v1/evaluations", {**order, "seeds": [5]}, headers=key), 422, "another request")
    # Keys are an owner's own.
    theirs = other.post("/v1/evaluations", {**order, "agent": "b"}, headers=key)
    assert theirs.status_code == 201
    assert theirs.json()["id"] != first.json()["id"]


def test_a_key_used_at_the_same_moment_makes_one_evaluation(stored: Harness) -> None:
    team = stored.caller("team")
    team.agent("a")
    answers = []

    def send() -> None:
        order = {"agent": "a", "benchmark": "quickstart", "seeds": [0]}
        answers.append(team.post("/v1/evaluations", order, headers={"idempotency-key": "k"}))

    threads = [threading.Thread(target=send) for _ in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert {answer.status_code for answer in answers} == {201}
    assert len({answer.json()["id"] for answer in answers}) == 1


def test_the_quota_is_per_owner_and_what_has_ended_does_not_count(tmp_path: Path) -> None:
    with running(tmp_path / "data", evaluations_per_owner=2) as service:
        team, other = service.caller("team"), service.caller("other")
        team.agent("a")
        other.agent("b")
        first = team.evaluation("a")
        team.evaluation("a")
        refused = team.post("/v1/evaluations", {"agent": "a", "benchmark": "quickstart"})
        assert_problem(refused, 429, "2 unfinished")
        assert int(refused.headers["retry-after"]) > 0
        other.evaluation("b")
        finish(service.services.database, first, EvaluationStatus.DONE, EpisodeStatus.DONE)
        team.evaluation("a")


def test_the_quota_holds_for_requests_at_the_same_moment(stored: Harness) -> None:
    quota = stored.services.settings.evaluations_per_owner
    team = stored.caller("team")
    team.agent("a")
    for _ in range(quota - 2):
        team.evaluation("a", seeds=[0])
    statuses: list[int] = []

    def send() -> None:
        order = {"agent": "a", "benchmark": "quickstart", "seeds": [0]}
        statuses.append(team.post("/v1/evaluations", order).status_code)

    threads = [threading.Thread(target=send) for _ in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(statuses) == [201, 201, 429, 429, 429, 429]


def test_a_full_queue_says_so(tmp_path: Path) -> None:
    scenarios = len(load_benchmark("quickstart").scenarios([0]))
    with running(tmp_path / "data", queue_limit=2 * scenarios) as service:
        team = service.caller("team")
        team.agent("a")
        evaluation = team.evaluation("a", seeds=[0])
        refused = team.post("/v1/evaluations", {"agent": "a", "benchmark": "quickstart", "seeds": [0, 1]})
        assert_problem(refused, 503, "queue")
        assert int(refused.headers["retry-after"]) > 0
        team.evaluation("a", seeds=[1])
        finish(service.services.database, evaluation, EvaluationStatus.DONE, EpisodeStatus.DONE)
        team.evaluation("a", seeds=[2])


def test_resume_queues_what_was_lost_and_nothing_else(stored: Harness) -> None:
    team = stored.caller("team")
    team.agent("a")
    evaluation = team.evaluation("a")
    database = stored.services.database
    with database.session() as session:
        done, lost, *_ = list_episodes(session, evaluation)
        done.status, done.record_hash, done.attempts = EpisodeStatus.DONE, "ab" * 32, 1
        lost.status, lost.failure, lost.attempts = EpisodeStatus.LOST, "the process died", 2
    assert team.post(f"/v1/evaluations/{evaluation}/resume").json()["progress"]["lost"] == 1  # it still runs
    finish(database, evaluation, EvaluationStatus.FAILED, EpisodeStatus.CANCELLED)
    resumed = team.post(f"/v1/evaluations/{evaluation}/resume").json()
    assert (resumed["status"], resumed["finished"], resumed["failure"]) == ("queued", None, None)
    assert resumed["progress"]["done"] == 1
    assert resumed["progress"]["queued"] == resumed["progress"]["total"] - 1
    episodes = team.get(f"/v1/evaluations/{evaluation}/episodes").json()["items"]
    assert episodes[0]["record_hash"] == "ab" * 32
    with database.session() as session:  # the interface tells nothing of a remote agent's episode before its end
        again = list_episodes(session, evaluation)[1]
        assert (again.attempts, again.failure) == (2, None)
    assert stored.scheduler.calls[-1] == "wake"


def test_an_evaluation_that_has_ended_cannot_be_cancelled(service: Harness) -> None:
    team = service.caller("team")
    team.agent("a")
    evaluation = team.evaluation("a")
    finish(service.services.database, evaluation, EvaluationStatus.DONE, EpisodeStatus.DONE)
    assert_problem(team.post(f"/v1/evaluations/{evaluation}/cancel"), 409, "done")
    assert team.post(f"/v1/evaluations/{evaluation}/resume").json()["status"] == "done"
    assert_problem(team.post("/v1/evaluations/ev-none/cancel"), 404)


def test_an_administrator_may_cancel_for_others(service: Harness) -> None:
    team, admin = service.caller("team"), service.caller("root", Role.ADMIN)
    team.agent("a")
    evaluation = team.evaluation("a")
    assert admin.post(f"/v1/evaluations/{evaluation}/cancel").json()["owner"] == "team"


def _events(text: str) -> list[tuple[str, dict[str, object]]]:
    events = []
    for block in text.split("\n\n"):
        lines = dict(line.split(": ", 1) for line in block.split("\n") if line and not line.startswith(":"))
        if "event" in lines:
            events.append((lines["event"], json.loads(lines["data"])))
    return events


def test_progress_tells_the_state_first_then_each_episode_then_the_end(service: Harness) -> None:
    team = service.caller("team")
    team.agent("a")
    evaluation = team.evaluation("a")
    topic, events = f"evaluation:{evaluation}", service.services.events
    listening = threading.Event()

    def drive() -> None:
        listening.wait(120)
        events.publish(topic, {"episode": "ep-1", "status": "done", "done": 1, "total": 6})
        events.publish("evaluation:ev-other", {"episode": "ep-9", "status": "done"})
        finish(service.services.database, evaluation, EvaluationStatus.DONE, EpisodeStatus.DONE)
        events.publish(topic, {"evaluation": evaluation, "status": "done"})

    driver = threading.Thread(target=drive)
    driver.start()
    subscribe = events.subscribe

    def noticed(name: str) -> object:
        listening.set()
        return subscribe(name)

    events.subscribe = noticed  # type: ignore[method-assign,assignment]
    answer = team.get(f"/v1/evaluations/{evaluation}/progress")
    driver.join()
    assert answer.headers["content-type"].startswith("text/event-stream")
    (first, state), *between, (last, end) = _events(answer.text)
    assert (first, state["id"], last, end["status"]) == ("state", evaluation, "end", "done")
    assert [data for name, data in between if name == "episode"] in (
        [{"episode": "ep-1", "status": "done", "done": 1, "total": 6}],
        [],  # the state that was read first already holds it
    )
    assert not events._subscriptions


def test_a_reader_that_comes_back_after_the_end_is_told_to_stop(service: Harness) -> None:
    team = service.caller("team")
    team.agent("a")
    evaluation = team.evaluation("a")
    finish(service.services.database, evaluation, EvaluationStatus.CANCELLED, EpisodeStatus.CANCELLED)
    path = f"/v1/evaluations/{evaluation}/progress"
    assert [name for name, _ in _events(team.get(path).text)] == ["state", "end"]
    assert "id: end" in team.get(path).text
    assert team.get(path, headers={"last-event-id": "end"}).status_code == 204
    assert team.get(path, headers={"last-event-id": "17"}).status_code == 200


def test_the_key_of_a_deleted_evaluation_orders_a_new_one(stored: Harness) -> None:
    team = stored.caller("team")
    team.agent("a")
    order, key = {"agent": "a", "benchmark": "quickstart"}, {"idempotency-key": "k"}
    deleted = team.post("/v1/evaluations", order, headers=key).json()["id"]
    assert team.post(f"/v1/evaluations/{deleted}/cancel").status_code == 200
    assert team.delete(f"/v1/evaluations/{deleted}").status_code == 204
    again = team.post("/v1/evaluations", order, headers=key)
    assert again.status_code == 201, again.text
    assert again.json()["id"] != deleted
    assert team.post("/v1/evaluations", order, headers=key).json()["id"] == again.json()["id"]


@pytest.fixture
def upgraded(stored: Harness, monkeypatch: pytest.MonkeyPatch) -> Caller:
    """An owner whose built-in agent `a` has other code since an upgrade, and whose agent `b` has not."""
    monkeypatch.setattr(installed, "_unchanged", set())
    team = stored.caller("team")
    for name in ("a", "b"):
        assert team.post("/v1/agents", {"name": name}).status_code == 201
        assert team.post(f"/v1/agents/{name}/submissions", {"kind": "builtin", "entry": "random"}).status_code == 201
    with stored.services.database.session() as session:
        changed = session.execute(select(Submission).join(Agent).where(Agent.name == "a")).scalars().one()
        changed.info = changed.info | {"source_sha256": "0" * 64}
    installed._unchanged.clear()  # as after a start
    return team


def test_a_built_in_agent_whose_code_has_changed_is_refused_when_it_is_ordered(upgraded: Caller) -> None:
    order = {"agent": "a", "benchmark": "quickstart", "ranked": True}
    for _ in range(11):  # more often than a day has runs
        assert_problem(upgraded.post("/v1/evaluations", order), 409, "its code has changed", "submit it again")
    mixed = {"agent": "b", "benchmark": "fleet", "egos": {"west-1": {"agent": "a"}}}
    assert_problem(upgraded.post("/v1/evaluations", mixed), 409, "submit it again")
    assert upgraded.get("/v1/evaluations").json()["items"] == []
    upgraded.evaluation("b", ranked=True)
    assert upgraded.post("/v1/agents/a/submissions", {"kind": "builtin", "entry": "random"}).status_code == 201
    upgraded.evaluation("a", ranked=True)


def test_a_built_in_agent_that_is_there_no_more_is_refused(upgraded: Caller, stored: Harness) -> None:
    with stored.services.database.session() as session:
        gone = session.execute(select(Submission).join(Agent).where(Agent.name == "a")).scalars().one()
        gone.info = gone.info | {"entry": "dohyo.agents.nothing:Gone"}
    answer = upgraded.post("/v1/evaluations", {"agent": "a", "benchmark": "quickstart"})
    assert_problem(answer, 409, "cannot be made any more: no built-in agent is 'dohyo.agents.nothing:Gone'")


def test_a_run_of_a_built_in_agent_whose_code_has_changed_does_not_go_on(upgraded: Caller, stored: Harness) -> None:
    run = upgraded.evaluation("b", seeds=[0])
    finish(stored.services.database, run, EvaluationStatus.FAILED, EpisodeStatus.LOST)
    with stored.services.database.session() as session:
        changed = session.execute(select(Submission).join(Agent).where(Agent.name == "b")).scalars().one()
        changed.info = changed.info | {"files_sha256": "0" * 64}
    installed._unchanged.clear()
    assert_problem(upgraded.post(f"/v1/evaluations/{run}/resume"), 409, "submit it again")


@pytest.mark.parametrize("what", ["metrics", "metrics.csv", "infractions"])
def test_metrics_of_an_evaluation_that_is_deleted_after_the_check_are_not_found(
    service: Harness, monkeypatch: pytest.MonkeyPatch, what: str
) -> None:
    team, database = service.caller("team"), service.services.database
    team.agent("a")
    run = team.evaluation("a")
    finish(database, run, EvaluationStatus.CANCELLED, EpisodeStatus.CANCELLED)

    def checked_and_deleted(*args: Any) -> Any:
        found = evaluation_for(*args)
        with database.session() as session:
            delete_evaluation(session, session.get_one(Evaluation, run))
        return found

    monkeypatch.setattr(metrics_routes, "evaluation_for", checked_and_deleted)
    assert_problem(team.get(f"/v1/evaluations/{run}/{what}"), 404, run)
