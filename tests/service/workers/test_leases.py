"""The lease book against a process that says what the test tells it to say."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any, cast

import msgspec
import pytest

from dohyo.evaluation.freeway.benchmark import load_freeway_benchmark
from dohyo.evaluation.freeway.morning import MorningScenario
from dohyo.evaluation.records.record import AgentInfo
from dohyo.service.database.engine import Database
from dohyo.service.errors import ConflictError, GoneError, UnauthorisedError
from dohyo.service.running.channel import SEEN, Fault, Kind
from dohyo.service.running.order import EpisodeOrder
from dohyo.service.running.process import End, EpisodeProcess, Outcome
from dohyo.service.scheduling.scheduler import Scheduler
from dohyo.service.settings import Settings
from dohyo.service.state import Broadcast
from dohyo.service.wire.bodies import Step
from dohyo.service.wire.messages import Format, encode_observations
from dohyo.service.wire.requests import StaleTickError
from dohyo.service.workers import leases as module
from dohyo.service.workers import loop_clock
from dohyo.service.workers.lease import Lease, RemoteEpisode, Worker
from dohyo.service.workers.leases import LeaseBook
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.scenario import Mission, Place, Scenario
from tests.service.tables import sqlite_with_tables

TTL_S, DEADLINE_S = 30.0, 10.0


class Clock:
    """Time that passes when a test says so."""

    def __init__(self) -> None:
        self.now = 1000.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture(autouse=True)
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    """The clock of all leases."""
    made = Clock()
    monkeypatch.setattr(loop_clock, "time", made)
    return made


class FakeProcess:
    """Remembers what it was sent; says what it is told to."""

    def __init__(self) -> None:
        self.seen: Callable[[Kind, bytes], None] = lambda kind, payload: None
        self.sent: list[tuple[Kind, bytes]] = []
        self.killed: Outcome | None = None

    def send(self, kind: Kind, payload: bytes = b"") -> None:
        self.sent.append((kind, payload))

    def kill(self, why: Outcome | None = None) -> None:
        self.killed = why

    def show(self, tick: int, missed: int = 0) -> None:
        self.seen(Kind.SEEN, SEEN.pack(tick, tick / 10, missed, 0) + encode_observations({"ego": {}}))

    def refuse(self, why: str) -> None:
        self.seen(Kind.REFUSED, why.encode())

    def kinds(self) -> list[Kind]:
        return [kind for kind, _ in self.sent]


def episode(agent: str = "mine", slow_policy: Any = "wait", stem: str = "s") -> tuple[RemoteEpisode, FakeProcess]:
    place = Place(lane="a_0")
    process = FakeProcess()
    order = EpisodeOrder(
        scenario=Scenario(network="n", missions=(Mission(start=place, goal=place),)),
        info=AgentInfo(name=agent, entry="x:Y", track="map", sensors=("route",), control="lane_command"),
        benchmark=("b", "0" * 64),
        directory=Path(),
        stem=stem,
        act_deadline_s=DEADLINE_S,
        remote=True,
        slow_policy=slow_policy,
    )
    return RemoteEpisode(agent, 1, 1, order, cast(EpisodeProcess, process)), process


def run(test: Awaitable[None]) -> None:
    asyncio.run(asyncio.wait_for(test, 120))  # type: ignore[arg-type]


def hired(
    book: LeaseBook, agent: str = "mine", capacity: int = 1, version: int | None = None, token_id: str = "tok-1"
) -> Worker:
    return book.register(agent, "owner", token_id, capacity, version)


async def never() -> None:
    await asyncio.Event().wait()


async def acquired(book: LeaseBook, worker: Worker, wait_s: float = 0.0) -> Lease | None:
    here = asyncio.ensure_future(never())
    try:
        return await book.acquire(worker, wait_s, here)
    finally:
        here.cancel()


async def leased(book: LeaseBook, slow_policy: str = "wait", stem: str = "s") -> tuple[Lease, FakeProcess]:
    one, process = episode(slow_policy=slow_policy, stem=stem)
    book.expect(one)
    process.show(0)
    lease = await acquired(book, hired(book))
    assert lease is not None
    return lease, process


def answer(tick: int) -> Step:
    return Step(tick, msgspec.Raw(msgspec.msgpack.encode({"ego": [1.0, 0.0]})))


async def stepped(book: LeaseBook, lease: Lease, process: FakeProcess, tick: int) -> Any:
    task = asyncio.create_task(book.step(lease, answer(tick), Format.MSGPACK))
    await asyncio.sleep(0)
    process.show(tick + 1)
    return await task


def test_a_waiting_worker_gets_the_episode_of_its_agent_and_version_only() -> None:
    async def test() -> None:
        book = LeaseBook(TTL_S)
        other, old, fits = hired(book, "other"), hired(book, version=7), hired(book, version=1)
        polls = [asyncio.create_task(acquired(book, one, 0.3)) for one in (other, old, fits)]
        await asyncio.sleep(0)
        one, process = episode()
        book.expect(one)
        assert process.kinds() == []
        process.show(0)
        given = await asyncio.gather(*polls)
        assert given[:2] == [None, None]
        assert given[2] is not None
        assert given[2].episode is one
        assert process.kinds() == [Kind.GRANT]

    run(test())


def test_steps_go_in_lockstep_and_the_same_tick_gets_the_same_reply() -> None:
    async def test() -> None:
        book = LeaseBook(TTL_S)
        lease, process = await leased(book)
        first = await stepped(book, lease, process, 0)
        assert (first.tick, first.time_s, first.done, first.directive) == (1, 0.1, False, "run")
        assert await book.step(lease, answer(0), Format.MSGPACK) is first
        assert process.kinds().count(Kind.ACTIONS) == 1
        for wrong in (-1, 2, 3):
            with pytest.raises(StaleTickError) as caught:
                await book.step(lease, answer(wrong), Format.MSGPACK)
            assert caught.value.expected == 1
        assert (await stepped(book, lease, process, 1)).tick == 2

    run(test())


def test_a_step_sent_again_while_the_first_is_under_way_drives_once() -> None:
    async def test() -> None:
        book = LeaseBook(TTL_S)
        lease, process = await leased(book)
        tasks = [asyncio.create_task(book.step(lease, answer(0), Format.MSGPACK)) for _ in range(3)]
        await asyncio.sleep(0)
        tasks[0].cancel()
        process.show(1)
        assert (await tasks[1]) is (await tasks[2])
        assert process.kinds().count(Kind.ACTIONS) == 1

    run(test())


def test_a_refused_action_leaves_the_lease_until_the_decision_is_due(clock: Clock) -> None:
    async def test() -> None:
        book = LeaseBook(TTL_S)
        lease, process = await leased(book)
        await stepped(book, lease, process, 0)
        for _ in range(2):
            task = asyncio.create_task(book.step(lease, answer(1), Format.MSGPACK))
            await asyncio.sleep(0)
            process.refuse("expected finite numbers")
            with pytest.raises(InvalidInputError, match="finite"):
                await task
        book.sweep()
        assert not lease.ended
        clock.now += DEADLINE_S + 1.0
        book.sweep()
        kind, payload = process.sent[-1]
        assert kind is Kind.FAULT
        assert json.loads(payload) == [Fault.TIMEOUT, f"agent 'mine' took longer than {DEADLINE_S:g} s"]
        with pytest.raises(GoneError):
            await book.step(lease, answer(1), Format.MSGPACK)

    run(test())


async def beat(book: LeaseBook, lease: Lease) -> None:
    book.heartbeat(lease)


signs: dict[str, Callable[[LeaseBook, Lease], Awaitable[Any]]] = {
    "step": lambda book, lease: book.step(lease, answer(1), Format.MSGPACK),
    "heartbeat": beat,
}


@pytest.mark.parametrize("sign", signs)
def test_a_sign_of_life_after_the_deadline_makes_it_the_agents_fault(sign: str, clock: Clock) -> None:
    async def test() -> None:
        book = LeaseBook(TTL_S)
        lease, process = await leased(book)
        await stepped(book, lease, process, 0)
        clock.now += DEADLINE_S + 1.0
        book.sweep()
        assert not lease.ended
        with pytest.raises(GoneError, match="took longer"):
            await signs[sign](book, lease)
        assert process.kinds()[-1] is Kind.FAULT
        assert process.killed is None

    run(test())


def test_a_standstill_of_the_service_is_not_charged_to_the_agent(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.undo()  # the real clock
    monkeypatch.setattr("dohyo.service.scheduling.scheduler.dismiss_workers", lambda *_: never())

    async def test() -> None:
        sqlite_with_tables(tmp_path / "dohyo.db")
        settings = Settings(data=tmp_path, _env_file=None)
        scheduler = Scheduler(settings, Database(settings.database_url), Broadcast())
        await scheduler.start()
        try:
            lease, process = await leased(scheduler.leases)
            lease.episode.order = lease.episode.order.model_copy(update={"act_deadline_s": 1.0})
            await stepped(scheduler.leases, lease, process, 0)
            await asyncio.sleep(0.2)
            time.sleep(2.0)  # the whole loop
            await stepped(scheduler.leases, lease, process, 1)
            while scheduler.leases._clock.monotonic() <= lease.due:  # a slow machine lets the loop stand still, too
                await asyncio.sleep(0.05)
            with pytest.raises(GoneError, match="took longer than 1 s"):
                await scheduler.leases.step(lease, answer(2), Format.MSGPACK)
        finally:
            await scheduler.stop()

    run(test())


def test_silence_is_told_as_a_worker_that_is_gone(clock: Clock) -> None:
    async def test() -> None:
        book = LeaseBook(TTL_S)
        lease, process = await leased(book)
        await stepped(book, lease, process, 0)
        clock.now += TTL_S + 1.0
        book.sweep()
        assert process.killed is not None
        assert process.killed.end is End.WORKER_GONE
        assert Kind.FAULT not in process.kinds()
        with pytest.raises(GoneError, match="not heard of"):
            await book.step(lease, answer(1), Format.MSGPACK)

    run(test())


def test_heartbeats_keep_a_lease_alive_while_a_model_loads(clock: Clock) -> None:
    async def test() -> None:
        book = LeaseBook(TTL_S)
        lease, process = await leased(book)
        for _ in range(4):
            clock.now += TTL_S / 2
            book.heartbeat(lease)
            book.sweep()
        assert not lease.ended
        assert (await stepped(book, lease, process, 0)).tick == 1

    run(test())


def test_nobody_reaches_another_workers_lease_and_an_old_lease_not_the_new_episode() -> None:
    async def test() -> None:
        book = LeaseBook(TTL_S)
        lease, process = await leased(book)
        stranger = hired(book)
        with pytest.raises(GoneError, match="no lease"):
            book.lease_of(stranger, lease.id)
        with pytest.raises(GoneError):
            book.lease_of(lease.worker, "l-unknown")
        with pytest.raises(UnauthorisedError):
            book.worker_of("no such token")
        await stepped(book, lease, process, 0)
        book.release(lease, None, "shutdown")
        again, new_process = episode()
        book.expect(again)
        new_process.show(0)
        second = await acquired(book, stranger)
        assert second is not None
        with pytest.raises(GoneError):
            await book.step(lease, answer(1), Format.MSGPACK)
        assert Kind.ACTIONS not in new_process.kinds()

    run(test())


def test_a_worker_holds_no_more_than_it_said() -> None:
    async def test() -> None:
        book = LeaseBook(TTL_S)
        lease, _ = await leased(book)
        with pytest.raises(ConflictError, match="at most 1"):
            await acquired(book, lease.worker)

    run(test())


def test_an_episode_given_to_a_worker_that_has_just_left_goes_to_the_next() -> None:
    async def test() -> None:
        book = LeaseBook(TTL_S)
        gone, there = hired(book), hired(book)
        left = asyncio.get_running_loop().create_future()
        poll = asyncio.create_task(book.acquire(gone, 5.0, left))
        await asyncio.sleep(0)
        one, process = episode()
        book.expect(one)
        left.set_result(None)
        process.show(0)
        assert await poll is None
        lease = await acquired(book, there)
        assert lease is not None
        assert lease.worker is there

    run(test())


def test_a_worker_without_a_valid_token_waits_no_longer_and_the_next_one_gets_the_episode() -> None:
    async def test() -> None:
        book = LeaseBook(TTL_S)
        revoked, good = hired(book, token_id="tok-revoked"), hired(book)
        polls = [asyncio.create_task(acquired(book, one, 5.0)) for one in (revoked, good)]
        await asyncio.sleep(0)
        book.dismiss("tok-revoked")
        one, process = episode()
        book.expect(one)
        process.show(0)
        with pytest.raises(UnauthorisedError, match="no longer valid"):
            await polls[0]
        lease = await polls[1]
        assert lease is not None
        assert lease.worker is good

    run(test())


def test_a_worker_dismissed_after_its_token_was_checked_gets_no_episode() -> None:
    async def test() -> None:
        book = LeaseBook(TTL_S)
        one, process = episode()
        book.expect(one)
        process.show(0)
        late, good = hired(book, token_id="tok-revoked"), hired(book)
        book.dismiss("tok-revoked")
        with pytest.raises(UnauthorisedError, match="no longer valid"):
            await acquired(book, late)
        assert await acquired(book, good) is not None

    run(test())


def test_an_episode_lost_in_the_moment_of_its_grant_is_neither_shown_nor_offered() -> None:
    async def test() -> None:
        book = LeaseBook(TTL_S)
        revoked, good = hired(book, token_id="tok-revoked"), hired(book)
        left = asyncio.get_running_loop().create_future()
        poll = asyncio.create_task(book.acquire(revoked, 5.0, left))
        await asyncio.sleep(0)
        one, process = episode()
        book.expect(one)
        process.show(0)
        left.set_result(None)
        book.dismiss("tok-revoked")
        assert process.killed is not None
        with pytest.raises(UnauthorisedError):
            await poll
        assert await acquired(book, good) is None

    run(test())


def test_three_returns_without_a_step_are_free_and_the_fourth_ends_the_attempt() -> None:
    async def test() -> None:
        book = LeaseBook(TTL_S)
        lease, process = await leased(book)
        for _ in range(3):
            book.release(lease, None, "not today")
            assert process.killed is None
            again = await acquired(book, lease.worker)
            assert again is not None
            lease = again
        book.release(lease, None, "not today")
        assert process.killed is not None
        assert process.killed.end is End.GIVEN_BACK

    run(test())


def test_returns_are_counted_over_all_attempts_of_an_episode(clock: Clock) -> None:
    """Nobody claims it after a return, then its owner cancels and resumes: the first observations stay seen."""

    async def test() -> None:
        book = LeaseBook(TTL_S)
        lease, process = await leased(book)
        book.release(lease, None, "not today")
        clock.now += TTL_S + 1
        book.sweep()
        assert process.killed is not None
        assert process.killed.end is End.UNCLAIMED
        book.ended(lease.episode, process.killed)
        for _ in range(2):
            lease, process = await leased(book)
            assert not book.is_costly(lease.episode)
            book.ended(lease.episode, Outcome(End.STOPPED), "abort")
        lease, process = await leased(book)
        assert book.is_costly(lease.episode)
        book.release(lease, None, "not today")
        assert process.killed is not None
        assert process.killed.end is End.GIVEN_BACK

    run(test())


def test_returns_are_counted_of_the_episodes_that_returned_last(monkeypatch: pytest.MonkeyPatch) -> None:
    """Episodes of cancelled evaluations never finish, and must not be remembered for ever."""

    async def test() -> None:
        book = LeaseBook(TTL_S)
        for stem in [*("first" for _ in range(3)), *(f"other-{number}" for number in range(4))]:
            lease, _ = await leased(book, stem=stem)
            book.ended(lease.episode, Outcome(End.STOPPED), "abort")
        for _ in range(3):
            lease, _ = await leased(book, stem="last")
            assert not book.is_costly(lease.episode)
            book.ended(lease.episode, Outcome(End.STOPPED), "abort")
        costly = {stem: book.is_costly((await leased(book, stem=stem))[0].episode) for stem in ("first", "last")}
        assert costly == {"first": False, "last": True}

    monkeypatch.setattr(module, "MOST_RETURNED", 4, raising=False)
    run(test())


def test_an_episode_given_back_untouched_is_offered_again_and_a_touched_one_is_lost() -> None:
    async def test() -> None:
        book = LeaseBook(TTL_S)
        lease, process = await leased(book)
        book.release(lease, None, "not today")
        assert process.killed is None
        again = await acquired(book, lease.worker)
        assert again is not None
        await stepped(book, again, process, 0)
        book.release(again, None, "not today")
        assert process.killed is not None
        assert "not today" in process.killed.text

    run(test())


def test_releasing_with_an_error_is_the_agents_fault() -> None:
    async def test() -> None:
        book = LeaseBook(TTL_S)
        lease, process = await leased(book)
        book.release(lease, Fault.RAISED, "ValueError: out of ideas (mine.py:3)")
        assert process.sent[-1] == (Kind.FAULT, b'["raised", "ValueError: out of ideas (mine.py:3)"]')

    run(test())


def test_the_end_is_told_even_if_the_first_telling_was_lost() -> None:
    async def test() -> None:
        book = LeaseBook(TTL_S)
        lease, _ = await leased(book)
        task = asyncio.create_task(book.step(lease, answer(0), Format.MSGPACK))
        await asyncio.sleep(0)
        book.ended(lease.episode, Outcome(End.FINISHED, last=SEEN.pack(1, 0.1, 0, 0)))
        first = await task
        assert (first.done, first.tick) == (True, 1)
        assert await book.step(lease, answer(0), Format.MSGPACK) is first
        assert not lease.worker.leases

    run(test())


def test_a_dead_process_ends_the_lease_and_not_with_done() -> None:
    async def test() -> None:
        book = LeaseBook(TTL_S)
        lease, _ = await leased(book)
        task = asyncio.create_task(book.step(lease, answer(0), Format.MSGPACK))
        await asyncio.sleep(0)
        book.ended(lease.episode, Outcome(End.DIED, "episode process ended with code -9"))
        with pytest.raises(GoneError, match="-9"):
            await task

    run(test())


@pytest.mark.parametrize("family", ["driving", "freeway"])
def test_a_tick_that_never_ends_is_a_fault_of_the_simulation(clock: Clock, family: str) -> None:
    """A minute of the freeway may take ten, or a planner could lose its morning by filling the road."""

    async def test() -> None:
        book = LeaseBook(TTL_S)
        lease, process = await leased(book)
        if family == "freeway":
            benchmark = load_freeway_benchmark("dissipation")
            morning = MorningScenario(benchmark=benchmark, seed=1)  # type: ignore[arg-type]  # it is of traffic
            lease.episode.order = lease.episode.order.model_copy(update={"scenario": morning})
        task = asyncio.create_task(book.step(lease, answer(0), Format.MSGPACK))
        await asyncio.sleep(0)
        longest_s = {"driving": 120.0, "freeway": 600.0}[family]
        clock.now += longest_s - 1.0
        book.sweep()
        assert process.killed is None
        clock.now += 2.0
        book.sweep()
        assert process.killed is not None
        assert process.killed.end is End.FAILED
        with pytest.raises(GoneError, match=f"longer than {longest_s:g} s for one tick"):
            await task

    run(test())


@pytest.mark.parametrize("end", [End.FAILED, End.IMPOSSIBLE])
def test_the_text_of_a_failed_simulation_is_not_for_the_worker(end: End) -> None:
    async def test() -> None:
        book = LeaseBook(TTL_S)
        lease, _ = await leased(book)
        task = asyncio.create_task(book.step(lease, answer(0), Format.MSGPACK))
        await asyncio.sleep(0)
        book.ended(lease.episode, Outcome(end, "scenario 'nocrash-town-7': no lane '28639688#1_2'"))
        with pytest.raises(GoneError) as caught:
            await task
        assert "nocrash" not in str(caught.value)
        assert "28639688" not in str(caught.value)

    run(test())


def test_realtime_answers_with_the_newest_tick_and_counts_what_was_missed() -> None:
    async def test() -> None:
        book = LeaseBook(TTL_S)
        lease, process = await leased(book, slow_policy="realtime")
        await stepped(book, lease, process, 0)
        for tick in (2, 3, 4):
            process.show(tick, missed=tick - 1)
        task = asyncio.create_task(book.step(lease, answer(1), Format.MSGPACK))
        await asyncio.sleep(0)
        process.show(5, missed=3)
        reply = await task
        assert (reply.tick, reply.missed) == (5, 3)
        assert (await stepped(book, lease, process, 5)).tick == 6

    run(test())


def test_draining_is_told_with_the_next_step_and_gives_out_nothing() -> None:
    async def test() -> None:
        book = LeaseBook(TTL_S)
        lease, process = await leased(book)
        waiting = asyncio.create_task(acquired(book, hired(book), 600.0))  # the test ends long before
        await asyncio.sleep(0)
        book.drain()
        assert await waiting is None
        assert (await stepped(book, lease, process, 0)).directive == "drain"
        one, other_process = episode()
        book.expect(one)
        other_process.show(0)
        assert await acquired(book, hired(book), 0.05) is None

    run(test())


def test_an_offer_that_nobody_takes_is_withdrawn_and_is_no_attempt(clock: Clock) -> None:
    async def test() -> None:
        book = LeaseBook(TTL_S)
        one, process = episode()
        book.expect(one)
        process.show(0)
        clock.now += TTL_S + 1.0
        book.sweep()
        assert process.killed is not None
        assert process.killed.end is End.UNCLAIMED

    run(test())


def test_silent_workers_and_ended_leases_are_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    async def test() -> None:
        book = LeaseBook(TTL_S)
        lease, _ = await leased(book)
        book.release(lease, Fault.RAISED, "x")
        monkeypatch.setattr(module, "FORGET_S", -1.0)
        book.sweep()
        with pytest.raises(UnauthorisedError):
            book.worker_of(lease.worker.token)
        with pytest.raises(GoneError):
            book.lease_of(lease.worker, lease.id)

    run(test())
