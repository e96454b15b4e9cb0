"""The queue: who is next, and that what comes late changes nothing."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from dohyo.service.database.engine import Database
from dohyo.service.evaluations.model import EpisodeStatus, Evaluation, EvaluationStatus
from dohyo.service.evaluations.queries import resume
from dohyo.service.scheduling import queue
from dohyo.service.scheduling.queue import Ticket
from dohyo.service.submissions.model import AgentKind
from tests.service.served import STEADY, Service, info_of, short


@pytest.fixture
def shop(tmp_path: Path) -> Iterator[Service]:
    """A service's data, without a service."""
    service = Service(tmp_path)
    yield service
    service.close()


def submit(shop: Service, owner: str = "owner", missions: int = 2) -> str:
    info = info_of(STEADY).model_copy(update={"name": f"agent-of-{owner}"})
    return shop.submit(info, short(missions), kind=AgentKind.BUILTIN, owner=owner)


def take(database: Database, evaluation_id: str) -> Ticket | None:
    with database.session() as session:
        (chosen,) = [one for one in queue.waiting(session) if one.evaluation_id == evaluation_id]
        return queue.take(session, chosen)


def taken(shop: Service, evaluation_id: str) -> Ticket:
    ticket = take(shop.database, evaluation_id)
    assert ticket is not None
    return ticket


def test_episodes_are_taken_in_order_each_once(shop: Service) -> None:
    evaluation = submit(shop)
    first, second = taken(shop, evaluation), taken(shop, evaluation)
    assert (first.position, second.position, first.attempt) == (0, 1, 1)
    assert shop.evaluation(evaluation).status is EvaluationStatus.RUNNING
    with shop.database.reading() as session:
        assert queue.waiting(session) == []
        assert queue.queued_count(session) == 0
        assert {one.episode_id for one in queue.running(session)} == {first.episode_id, second.episode_id}


def test_a_result_counts_once(shop: Service) -> None:
    evaluation = submit(shop)
    ticket = taken(shop, evaluation)
    with shop.database.session() as session:
        progress = queue.finish(session, ticket, "a" * 64, {})
        assert progress is not None
        assert (progress.done, progress.total, progress.ended) == (1, 2, False)
    with shop.database.session() as session:
        assert queue.finish(session, ticket, "b" * 64, {}) is None
        assert queue.lose(session, ticket, "late") is None
        queue.requeue(session, ticket.episode_id, "late", counted=True)
    assert shop.episodes(evaluation)[0].record_hash == "a" * 64


def test_an_evaluation_ends_done_only_if_all_are(shop: Service) -> None:
    good, bad = submit(shop, "good", 1), submit(shop, "bad", 2)
    with shop.database.session() as session:
        queue.finish(session, taken_in(session, good), "a" * 64, {})
        queue.finish(session, taken_in(session, bad), "b" * 64, {})
        progress = queue.lose(session, taken_in(session, bad), "SUMO lost the ego")
        assert progress is not None
        assert progress.ended
    assert shop.evaluation(good).status is EvaluationStatus.DONE
    ended = shop.evaluation(bad)
    assert ended.status is EvaluationStatus.FAILED
    assert ended.failure == "1 of 2 episodes were lost to the infrastructure, such as: SUMO lost the ego"
    assert ended.finished is not None


def taken_in(session: object, evaluation_id: str) -> Ticket:
    (chosen,) = [one for one in queue.waiting(session) if one.evaluation_id == evaluation_id]  # type: ignore[arg-type]
    ticket = queue.take(session, chosen)  # type: ignore[arg-type]
    assert ticket is not None
    return ticket


def test_a_cancelled_evaluation_takes_no_late_result_and_can_be_resumed(shop: Service) -> None:
    evaluation = submit(shop, missions=3)
    done, running = taken(shop, evaluation), taken(shop, evaluation)
    with shop.database.session() as session:
        queue.finish(session, done, "a" * 64, {})
        progress = queue.cancel(session, evaluation)
        assert progress is not None
        assert (progress.status, progress.done) == (EvaluationStatus.CANCELLED, 1)
        assert queue.cancel(session, evaluation) is None
        assert queue.finish(session, running, "b" * 64, {}) is None
    statuses = [one.status for one in shop.episodes(evaluation)]
    assert statuses == [EpisodeStatus.DONE, EpisodeStatus.CANCELLED, EpisodeStatus.CANCELLED]
    with shop.database.session() as session:
        assert resume(session, session.get_one(Evaluation, evaluation)) == 2
    assert (taken(shop, evaluation).position, taken(shop, evaluation).attempt) == (1, 1)


def test_an_attempt_that_was_none_is_not_counted(shop: Service) -> None:
    evaluation = submit(shop, missions=1)
    for counted, attempts in ((False, 0), (True, 1)):
        ticket = taken(shop, evaluation)
        with shop.database.session() as session:
            queue.requeue(session, ticket.episode_id, "why", counted=counted)
        (episode,) = shop.episodes(evaluation)
        assert (episode.status, episode.attempts, episode.failure) == (EpisodeStatus.QUEUED, attempts, "why")
    assert taken(shop, evaluation).attempt == 2
