"""The queue: who is next, and that what comes late changes nothing."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from pydantic import SecretStr
from sqlalchemy import select, text

from dohyo.service.boards.model import Ranking
from dohyo.service.database.engine import Database
from dohyo.service.evaluations.model import Attempt, AttemptOutcome, EpisodeStatus, Evaluation, EvaluationStatus
from dohyo.service.evaluations.queries import resume
from dohyo.service.scheduling import queue
from dohyo.service.scheduling.attempts import AttemptEnd
from dohyo.service.scheduling.queue import Next, Ticket
from dohyo.service.submissions.model import AgentKind
from tests.service.served import STEADY, Service, info_of, short, wait_until
from tests.service.tables import postgresql_with_tables

DONE = AttemptEnd(AttemptOutcome.DONE)


def ended(outcome: AttemptOutcome, why: str = "why") -> AttemptEnd:
    return AttemptEnd(outcome, why)


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


def test_episodes_of_a_remote_agent_come_in_a_random_order(shop: Service) -> None:
    info = info_of(STEADY).model_copy(update={"name": "remote"})
    evaluation = shop.submit(info, short(7), seeds=(0, 1, 2))
    order = [taken(shop, evaluation).position for _ in range(21)]
    assert sorted(order) == list(range(21))
    assert order != list(range(21))


def test_a_result_counts_once(shop: Service) -> None:
    evaluation = submit(shop)
    ticket = taken(shop, evaluation)
    with shop.database.session() as session:
        progress = queue.finish(session, ticket, "a" * 64, {}, DONE)
        assert progress is not None
        assert (progress.done, progress.total, progress.ended) == (1, 2, False)
    with shop.database.session() as session:
        assert queue.finish(session, ticket, "b" * 64, {}, DONE) is None
        assert queue.give_up(session, ticket, ended(AttemptOutcome.MACHINE, "late"), 10) == (Next.NOTHING, None)
        queue.requeue(session, ticket.key, ended(AttemptOutcome.MACHINE, "late"))
    assert shop.episodes(evaluation)[0].record_hash == "a" * 64


@pytest.mark.parametrize("change", ["finish", "give_up", "requeue", "fail"])
def test_a_drive_that_ends_while_its_evaluation_is_cancelled_waits_for_it(
    change: str, tmp_path: Path, postgres_server: str
) -> None:
    """With the locks in another order PostgreSQL would end one of the two as a deadlock."""
    shop = Service(tmp_path, database=SecretStr(postgresql_with_tables(postgres_server)))
    ticket = taken(shop, evaluation := submit(shop))
    changes = {
        "finish": lambda session: queue.finish(session, ticket, "a" * 64, {}, DONE),
        "give_up": lambda session: queue.give_up(session, ticket, ended(AttemptOutcome.MACHINE), 1)[1],
        "requeue": lambda session: queue.requeue(session, ticket.key, ended(AttemptOutcome.DRAINED)),
        "fail": lambda session: queue.fail(session, ticket, "why"),
    }

    def ends() -> object:
        with shop.database.session() as session:
            return changes[change](session)

    with ThreadPoolExecutor(1) as pool:
        with shop.database.session() as session:
            session.get(Evaluation, evaluation, with_for_update={"of": Evaluation})
            late = pool.submit(ends)
            wait_until(lambda: waits_for_a_lock(shop), "it does not wait")
            assert queue.cancel(session, evaluation) is not None
        assert late.result(60) is None
    assert shop.evaluation(evaluation).status is EvaluationStatus.CANCELLED
    assert [one.status for one in shop.episodes(evaluation)] == [EpisodeStatus.CANCELLED] * 2
    shop.close()


def waits_for_a_lock(shop: Service) -> bool:
    query = text(
        "SELECT count(*) FROM pg_stat_activity WHERE wait_event_type = 'Lock' AND datname = current_database()"
    )
    with shop.database.reading() as session:
        return bool(session.scalar(query))


def test_an_evaluation_ends_done_only_if_all_are(shop: Service) -> None:
    good, bad = submit(shop, "good", 1), submit(shop, "bad", 2)
    with shop.database.session() as session:
        queue.finish(session, taken_in(session, good), "a" * 64, {}, DONE)
        queue.finish(session, taken_in(session, bad), "b" * 64, {}, DONE)
        failed = ended(AttemptOutcome.SIMULATION, "SUMO lost the ego")
        assert queue.give_up(session, taken_in(session, bad), failed, 10) == (Next.AGAIN, None)
        what_next, progress = queue.give_up(session, taken_in(session, bad), failed, 10)
        assert what_next is Next.LOST
        assert progress is not None
        assert progress.ended
    assert shop.evaluation(good).status is EvaluationStatus.DONE
    failure = "1 of 2 episodes were lost to the infrastructure, such as: SUMO lost the ego (resume drives it once more)"
    after = shop.evaluation(bad)
    assert (after.status, after.failure) == (EvaluationStatus.FAILED, failure)
    assert after.finished is not None


def taken_in(session: object, evaluation_id: str) -> Ticket:
    (chosen,) = [one for one in queue.waiting(session) if one.evaluation_id == evaluation_id]  # type: ignore[arg-type]
    ticket = queue.take(session, chosen)  # type: ignore[arg-type]
    assert ticket is not None
    return ticket


def test_a_cancelled_evaluation_takes_no_late_result_and_can_be_resumed(shop: Service) -> None:
    evaluation = submit(shop, missions=3)
    done, running = taken(shop, evaluation), taken(shop, evaluation)
    with shop.database.session() as session:
        queue.finish(session, done, "a" * 64, {}, DONE)
        progress = queue.cancel(session, evaluation)
        assert progress is not None
        assert (progress.status, progress.done) == (EvaluationStatus.CANCELLED, 1)
        assert queue.cancel(session, evaluation) is None
        assert queue.finish(session, running, "b" * 64, {}, DONE) is None
    statuses = [one.status for one in shop.episodes(evaluation)]
    assert statuses == [EpisodeStatus.DONE, EpisodeStatus.CANCELLED, EpisodeStatus.CANCELLED]
    with shop.database.session() as session:
        assert resume(session, session.get_one(Evaluation, evaluation)) == 2
    assert [(one.position, one.attempt) for one in (taken(shop, evaluation), taken(shop, evaluation))] == [
        (1, 2),
        (2, 1),
    ]


def test_what_comes_late_from_a_cancelled_attempt_changes_nothing_of_the_next_one(shop: Service) -> None:
    """The evaluation is resumed before the old attempt's end: its episode runs again."""
    evaluation = submit(shop, missions=1)
    old = taken(shop, evaluation)
    with shop.database.session() as session:
        queue.cancel(session, evaluation)
        resume(session, session.get_one(Evaluation, evaluation))
    new = taken(shop, evaluation)
    with shop.database.session() as session:
        assert queue.finish(session, old, "a" * 64, {}, DONE) is None
        assert queue.give_up(session, old, ended(AttemptOutcome.MACHINE), 10) == (Next.NOTHING, None)
        assert queue.fail(session, old, "cannot be driven") is None
        queue.requeue(session, old.key, ended(AttemptOutcome.DRAINED))
    assert [(one.status, one.attempts) for one in shop.episodes(evaluation)] == [(EpisodeStatus.RUNNING, 2)]
    assert outcomes(shop) == [(1, "cancelled", False), (2, None, False)]
    with shop.database.session() as session:
        assert queue.finish(session, new, "b" * 64, {}, DONE) is not None


def test_an_episode_that_is_still_driven_is_not_taken(shop: Service) -> None:
    evaluation = submit(shop, missions=2)
    first, second = shop.episodes(evaluation)
    with shop.database.session() as session:
        (chosen,) = queue.waiting(session, [first.id])
        ticket = queue.take(session, chosen, [first.id])
        assert ticket is not None
        assert ticket.episode_id == second.id
        assert queue.waiting(session, [first.id]) == []
        assert queue.take(session, chosen, [first.id]) is None


def test_an_attempt_that_the_service_cut_off_is_not_counted(shop: Service) -> None:
    evaluation = submit(shop, missions=1)
    for outcome, attempts in ((AttemptOutcome.DRAINED, 0), (AttemptOutcome.MACHINE, 1)):
        ticket = taken(shop, evaluation)
        with shop.database.session() as session:
            queue.requeue(session, ticket.key, ended(outcome, "why"))
        (episode,) = shop.episodes(evaluation)
        assert (episode.status, episode.attempts, episode.failure) == (EpisodeStatus.QUEUED, attempts, "why")
    assert taken(shop, evaluation).attempt == 2
    assert outcomes(shop) == [(1, "drained", False), (2, "machine", False), (3, None, False)]


def outcomes(shop: Service) -> list[tuple[int, str | None, bool]]:
    """Number, outcome and charge of all attempts."""
    with shop.database.reading() as session:
        return [
            (one.number, one.outcome, one.charged) for one in session.scalars(select(Attempt).order_by(Attempt.number))
        ]


@pytest.mark.parametrize("leaving", [AttemptOutcome.GIVEN_BACK, AttemptOutcome.WORKER_GONE])
def test_the_second_time_that_a_worker_leaves_is_a_fault_of_the_agent(shop: Service, leaving: AttemptOutcome) -> None:
    evaluation = submit(shop, missions=1)
    with shop.database.session() as session:
        assert queue.give_up(session, taken_in(session, evaluation), ended(leaving), 10)[0] is Next.AGAIN
        assert queue.give_up(session, taken_in(session, evaluation), ended(leaving), 10)[0] is Next.AGENT_FAULT
    assert shop.episodes(evaluation)[0].status is EpisodeStatus.RUNNING, "the verdict is written next"


def test_a_ranked_run_has_few_second_tries(shop: Service) -> None:
    """Who leaves a bad drive knows what comes when it is driven again."""
    evaluation = shop.submit(info_of(STEADY), short(5), kind=AgentKind.BUILTIN, seeds=(0, 1))
    with shop.database.session() as session:
        run = session.get_one(Evaluation, evaluation)
        conditions = {"seeds": [0, 1], "act_deadline_s": 10.0, "runs_per_period": 1, "period_s": 1.0}
        ranking = Ranking(id="rk-1", benchmark_sha256=run.benchmark_sha256, **conditions)
        session.add(ranking)
        session.flush()
        run.ranking_id = ranking.id
        leave = ended(AttemptOutcome.GIVEN_BACK)
        tickets = [taken_in(session, evaluation) for _ in range(4)]
        said = [queue.give_up(session, ticket, leave, 10)[0] for ticket in tickets]
        assert said == [Next.AGAIN, Next.AGAIN, Next.AGENT_FAULT, Next.AGENT_FAULT]
        again = [taken_in(session, evaluation) for _ in range(2)]
        assert [(one.position, one.attempt, one.used_up) for one in again] == [(0, 2, False), (1, 2, False)]


def test_resume_erases_no_attempt(shop: Service) -> None:
    """A worker leaves, its owner cancels and resumes, the worker leaves again: the second attempt is the last."""
    evaluation = submit(shop, missions=1)
    with shop.database.session() as session:
        queue.give_up(session, taken_in(session, evaluation), ended(AttemptOutcome.GIVEN_BACK), 10)
        queue.cancel(session, evaluation)
        resume(session, session.get_one(Evaluation, evaluation))
        again = taken_in(session, evaluation)
        assert (again.attempt, again.used_up) == (2, False)
        assert queue.give_up(session, again, ended(AttemptOutcome.GIVEN_BACK), 10)[0] is Next.AGENT_FAULT


def test_a_cancelled_drive_is_no_free_second_try(shop: Service) -> None:
    evaluation = submit(shop, missions=1)
    for _ in range(2):
        ticket = taken(shop, evaluation)
        assert not ticket.used_up
        with shop.database.session() as session:
            queue.cancel(session, evaluation, charged=[ticket.episode_id])
            resume(session, session.get_one(Evaluation, evaluation))
    assert taken(shop, evaluation).used_up
    assert outcomes(shop)[:2] == [(1, "cancelled", True), (2, "cancelled", True)]


def test_deaths_of_the_process_are_not_the_agents_until_there_are_too_many(shop: Service) -> None:
    evaluation = submit(shop, missions=1)
    died = ended(AttemptOutcome.MACHINE, "code -9")
    with shop.database.session() as session:
        ends = [queue.give_up(session, taken_in(session, evaluation), died, 4)[0] for _ in range(4)]
    assert ends == [Next.AGAIN] * 3 + [Next.LOST]
    assert "code -9 (resume drives it once more)" in (shop.evaluation(evaluation).failure or "")
    with shop.database.session() as session:
        resume(session, session.get_one(Evaluation, evaluation))
        assert queue.give_up(session, taken_in(session, evaluation), died, 4)[0] is Next.LOST
