"""What an owner keeps: limited, deleted, and removed with time; ranked runs stay as rows."""

from __future__ import annotations

from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import select
from sqlalchemy.orm import Session

from dohyo.evaluation.records.record import EpisodeRecord
from dohyo.evaluation.records.trajectory import Trajectory
from dohyo.service.database.base import now
from dohyo.service.episodes import readers
from dohyo.service.errors import StorageFullError
from dohyo.service.evaluations.model import Attempt, Episode, EpisodeStatus, Evaluation, EvaluationStatus
from dohyo.service.scheduling import queue
from dohyo.service.storage import deletion, retention, usage
from dohyo.service.storage.usage import LARGE_RECORD, EpisodeCheck, check_bytes, kept_bytes
from dohyo.service.submissions.model import AgentKind, Submission
from tests.evaluation.builders import ego, episode
from tests.service.clock import WrongClock
from tests.service.harness import Caller, Harness, assert_problem, finish, running
from tests.service.policies.models import identity
from tests.service.served import STEADY, Service, info_of, short, wait_until
from tests.service.shop import Shop

SPEC = '{"track": "map", "sensors": ["speedometer"], "control": "target_speed_steering"}'


def one_record(number: int = 0) -> EpisodeRecord:
    return episode(ego(progress_m=100.0), name=f"scenario{number}")


def upload(team: Caller, agent: str, content: bytes) -> Any:
    files = {"spec": (None, SPEC), "file": ("policy.onnx", content)}
    return team.post(f"/v1/agents/{agent}/submissions/onnx", files=files)


def test_a_tenant_that_has_filled_its_share_deletes_first_and_others_go_on(tmp_path: Path) -> None:
    content = identity().SerializeToString()
    with running(tmp_path / "data", bytes_per_owner=len(content) + 10) as service:
        hog, other = service.caller("hog"), service.caller("other")
        for team, agent in ((hog, "h"), (other, "o")):
            assert team.post("/v1/agents", {"name": agent}).status_code == 201
        assert upload(hog, "h", content).status_code == 201
        assert_problem(upload(hog, "h", content), 507, "delete evaluations, submissions or networks first")
        assert list(service.services.settings.uploads.iterdir()) == [], "nothing of it is kept"
        assert upload(other, "o", content).status_code == 201
        policies = service.services.settings.policies
        assert hog.delete("/v1/agents/h/submissions/1").status_code == 204
        assert len(list(policies.glob("*.onnx"))) == 1, "the other owner has the same policy"
        assert_problem(other.delete("/v1/agents/h/submissions/1"), 403)
        assert other.delete("/v1/agents/o/submissions/1").status_code == 204
        assert list(policies.glob("*.onnx")) == []
        again = upload(hog, "h", content)
        assert (again.status_code, again.json()["version"]) == (201, 2), "a version is never given twice"


def test_an_evaluation_of_a_full_tenant_fails_with_the_reason_and_can_be_resumed(tmp_path: Path) -> None:
    service = Service(tmp_path / "data", processes=1, bytes_per_owner=1)
    try:
        full = service.submit(info_of(STEADY), short(2), kind=AgentKind.BUILTIN, owner="full")
        service.start()
        wait_until(lambda: service.evaluation(full).status.finished, "it does not end")
        assert service.evaluation(full).status is EvaluationStatus.FAILED
        assert "you keep" in str(service.evaluation(full).failure)
        statuses = [one.status for one in service.episodes(full)]
        assert statuses == [EpisodeStatus.DONE, EpisodeStatus.CANCELLED], "what was driven is kept"
        with service.database.reading() as session:
            assert kept_bytes(session, "full") > 1000
            with pytest.raises(StorageFullError):
                check_bytes(session, "full", 1)
            check_bytes(session, "other", 1)
            assert queue.waiting(session) == []
    finally:
        service.close()


def test_before_each_episode_the_sum_of_before_is_reused_where_it_leaves_room(
    shop: Shop, monkeypatch: pytest.MonkeyPatch
) -> None:
    sums: list[str] = []

    def counted(session: Session, owner: str) -> int:
        sums.append(owner)
        return kept_bytes(session, owner)

    def begin(check: EpisodeCheck, episodes: int, owner: str = "ann") -> int:
        """How often the owner's bytes are summed before so many episodes."""
        sums.clear()
        with shop.services.database.reading() as session:
            for _ in range(episodes):
                check.check(session, owner)
        return len(sums)

    monkeypatch.setattr(usage, "kept_bytes", counted)
    _, (one,) = shop.evaluation(shop.submission("agent"), [one_record()])
    roomy, narrow = EpisodeCheck(1000 * LARGE_RECORD), EpisodeCheck(10 * LARGE_RECORD)
    assert [begin(roomy, 500), begin(roomy, 1, "bob")] == [1, 1]
    assert begin(narrow, 90) == 10, "after as many episodes as surely have room"
    with shop.services.database.session() as session:
        session.get_one(Episode, one).kept_bytes = 2000 * LARGE_RECORD
    assert begin(roomy, 1) == 0
    monkeypatch.setattr(usage, "REUSED_S", -1.0)
    late = EpisodeCheck(3000 * LARGE_RECORD)
    assert begin(late, 5) == 5, "a sum that is too old does not count"
    full = EpisodeCheck(1000 * LARGE_RECORD)
    for _ in range(2):
        with pytest.raises(StorageFullError):
            begin(full, 1)
    with shop.services.database.session() as session:
        session.get_one(Episode, one).kept_bytes = 0
    assert begin(full, 1) == 1, "after a deletion it goes on at once"


def test_a_practice_run_is_deleted_once_it_has_ended(stored: Harness) -> None:
    team, other = stored.caller("team"), stored.caller("other")
    team.agent("a")
    evaluation = team.evaluation("a")
    path = f"/v1/evaluations/{evaluation}"
    assert_problem(team.delete(path), 409, "not ended")
    finish(stored.services.database, evaluation, EvaluationStatus.CANCELLED, EpisodeStatus.CANCELLED)
    assert_problem(other.delete(path), 403)
    assert_problem(team.delete("/v1/agents/a/submissions/1"), 409, evaluation)
    assert team.delete(path).status_code == 204
    assert_problem(team.get(path), 404)
    assert_problem(team.delete(path), 404)
    with stored.services.database.reading() as session:
        assert session.scalars(select(Episode)).all() == []
        assert session.scalars(select(Attempt)).all() == []
    assert team.delete("/v1/agents/a/submissions/1").status_code == 204


def test_a_ranked_run_is_never_deleted(stored: Harness) -> None:
    team = stored.caller("team")
    team.agent("a")
    ranked = team.evaluation("a", ranked=True)
    finish(stored.services.database, ranked, EvaluationStatus.DONE, EpisodeStatus.DONE)
    assert_problem(team.delete(f"/v1/evaluations/{ranked}"), 409, "ranked runs stay")


def test_a_record_that_two_runs_name_stays_until_the_last(shop: Shop) -> None:
    submission = shop.submission("agent")
    (first, (one,)), (second, (two,)) = (shop.evaluation(submission, [one_record()], ranked=False) for _ in range(2))
    path, derived = shop.path(one), shop.path(one).with_suffix(".replay-1-x.json.gz")
    derived.write_bytes(b"x")
    assert path == shop.path(two)
    for evaluation, stays in ((first, True), (second, False)):
        with shop.services.database.session() as session:
            hashes = deletion.delete_evaluation(session, session.get_one(Evaluation, evaluation))
        deletion.remove_records(shop.services.settings, shop.services.database, hashes)
        assert (path.exists(), path.with_suffix(".parquet").exists(), derived.exists()) == (stays, stays, stays)


def test_a_file_that_a_new_row_names_meanwhile_stays(shop: Shop, tmp_path: Path) -> None:
    """Between the deletion of rows and that of their files, others may bring the same content."""
    settings, database = shop.services.settings, shop.services.database
    submission = shop.submission("agent")
    first, (one,) = shop.evaluation(submission, [one_record()], ranked=False)
    path = shop.path(one)
    with database.session() as session:
        hashes = deletion.delete_evaluation(session, session.get_one(Evaluation, first))
    shop.evaluation(submission, [one_record()], ranked=False)
    deletion.remove_records(settings, database, hashes)
    assert path.exists()
    with running(tmp_path / "other") as service:
        settings, database = service.services.settings, service.services.database
        team, content = service.caller("team"), identity().SerializeToString()
        team.post("/v1/agents", {"name": "a"})
        assert upload(team, "a", content).status_code == 201
        with database.session() as session:
            policy = deletion.delete_submission(session, session.scalars(select(Submission)).one())
        assert upload(team, "a", content).status_code == 201
        assert policy is not None
        deletion.remove_policy(settings, database, policy)
        assert (settings.policies / f"{policy}.onnx").exists()


def test_a_file_that_is_being_read_is_read_to_its_end(shop: Shop, monkeypatch: pytest.MonkeyPatch) -> None:
    _, (one,) = shop.evaluation(shop.submission("agent"), [one_record()])
    table = shop.path(one).with_suffix(".parquet")
    content, real = table.read_bytes(), readers.trajectory_of

    def read_before_the_deletion(*arguments: Any) -> Trajectory:
        found = real(*arguments)
        table.unlink()
        return found

    monkeypatch.setattr(readers, "trajectory_of", read_before_the_deletion)
    assert shop.client.get(f"/v1/episodes/{one}/trajectory").content == content


def test_a_clock_that_is_wrong_for_a_moment_removes_no_record(shop: Shop, monkeypatch: pytest.MonkeyPatch) -> None:
    _, (one,) = shop.evaluation(shop.submission("new"), [one_record(1)])
    object.__setattr__(shop.services.settings, "records_kept_days", 30.0)
    clock = WrongClock(monkeypatch)
    passes = retention.Retention(shop.services)
    assert passes.remove() == 0
    clock.shift = timedelta(days=60)
    assert passes.remove() == 0, "set by two months"
    clock.shift = timedelta()
    assert passes.remove() == 0
    assert shop.client.get(f"/v1/episodes/{one}/record").status_code == 200
    clock.shift = timedelta(days=60)
    assert [passes.remove(), passes.remove()] == [0, 1], "a clock that stays there is right"


def test_old_records_go_and_their_rows_and_scores_stay(shop: Shop) -> None:
    ranked, (gone,) = shop.evaluation(shop.submission("old"), [one_record(1)])
    _, (kept,) = shop.evaluation(shop.submission("new"), [one_record(2)])
    with shop.services.database.session() as session:
        session.get_one(Evaluation, ranked).finished = now() - timedelta(days=40)
    assert retention.remove_old_records(shop.services) == 0, "without the setting, for ever"
    object.__setattr__(shop.services.settings, "records_kept_days", 30.0)
    assert retention.remove_old_records(shop.services) == 1
    assert retention.remove_old_records(shop.services) == 0
    assert shop.client.get(f"/v1/episodes/{gone}/record").status_code == 410
    assert shop.client.get(f"/v1/episodes/{kept}/record").status_code == 200
    assert shop.client.get(f"/v1/episodes/{gone}").json()["summary"] is not None
