"""WorldBook: all live worlds, one process each; how each has ended is stored in the database."""

from __future__ import annotations

import asyncio
import logging
import secrets
from collections.abc import Callable
from typing import Final

from sqlalchemy.orm import Session

from dohyo.evaluation.records.store import read_record
from dohyo.service.database.base import new_id
from dohyo.service.database.engine import Database, serialise
from dohyo.service.database.idempotency import made_before, remember
from dohyo.service.database.patience import PatientDatabase
from dohyo.service.episodes.archive import record_size
from dohyo.service.errors import BusyError, TooManyRequestsError, UnauthorisedError
from dohyo.service.periodic import ended
from dohyo.service.running.process import End, EpisodeProcess, Outcome
from dohyo.service.scheduling.dismissal import dismiss_workers
from dohyo.service.settings import Settings
from dohyo.service.simulating.order import WorldOrder, WorldRules
from dohyo.service.simulating.shown import SHOWN
from dohyo.service.storage.usage import check_bytes
from dohyo.service.workers.loop_clock import LoopClock
from dohyo.service.worlds import queries
from dohyo.service.worlds.live.seat import Seat
from dohyo.service.worlds.live.world import LiveWorld
from dohyo.service.worlds.model import World, WorldStatus
from dohyo.service.worlds.records import record_path, whole_record
from dohyo.sumo_networks.errors import InvalidInputError

ENTRY: Final = "dohyo.service.simulating.child:simulate_here"
Repeatable = tuple[str | None, str]
"""Idempotency-Key of a request, and the hash of its content."""
SWEEP_S: Final = 0.1
ENDED_SEATS: Final = 20
"""Of a world, which still answer the last request sent again."""
LEFT: Final = "the service ended while the world was live"
END_S: Final = 60.0  # for the rest of a tick and the record
FORGET_S: Final = 300.0

logger = logging.getLogger("dohyo.worlds")


class WorldBook:
    """Live worlds and the seats in them.

    Attributes:
        admission: Held while a guest is admitted or dismissed, in the database and in memory.
    """

    def __init__(self, settings: Settings, database: Database) -> None:
        """Begins without worlds."""
        self.admission = asyncio.Lock()
        self._settings, self._database = settings, database
        self._loop = LoopClock()
        self._live: dict[str, LiveWorld] = {}
        self._tasks: dict[str, asyncio.Task[Outcome]] = {}
        self._seats: dict[str, tuple[LiveWorld, Seat]] = {}
        self._over: dict[str, float] = {}  # time of the loop at the end of worlds whose seats are still known
        self._always: list[asyncio.Task[None]] = []
        self._stopping = False

    # Life

    async def start(self) -> None:
        """Ends the worlds that an earlier service left, then starts."""
        if left := await asyncio.to_thread(self._end_left):
            logger.warning("%d worlds were live when the service ended", left)
        always = (self._sweep(), dismiss_workers(PatientDatabase(self._database), self))
        self._always = [asyncio.create_task(one) for one in always]

    def _end_left(self) -> int:
        """Ends the worlds of an earlier service: done with a whole record, else failed. Returns their number."""
        with self._database.session() as session:
            left = queries.list_live_worlds(session)
            for row in left:
                if (whole := whole_record(self._settings, row)) is None:
                    status, reason, tick, kept = WorldStatus.FAILED, LEFT, row.tick, None
                else:
                    record, size = whole
                    status, reason, tick, kept = WorldStatus.DONE, None, record.ticks, (record.record_hash, size)
                    row.order = row.order | {"seed": record.scenario.seed}
                queries.finish_world(session, row.id, status, reason, tick, kept)
            return len(left)

    async def stop(self) -> None:
        """Ends all worlds, with their records."""
        self._stopping = True
        for world in self._live.values():
            world.end("the service ended")
        if self._tasks:
            await asyncio.wait(self._tasks.values(), timeout=max(1.0, self._settings.drain_s))
        tasks = [*self._tasks.values(), *self._always]
        for task in tasks:
            task.cancel()
        await ended(tasks, logger)

    async def _sweep(self) -> None:
        while True:
            await asyncio.sleep(SWEEP_S)
            self._loop.tick()
            now = self._loop.monotonic()
            for world in list(self._live.values()):
                world.sweep()
                if world.simulation.begun and now - world.heard > self._settings.world_idle_s and not world.ending:
                    self.end_later(world, f"no request came for {self._settings.world_idle_s:g} s")
            for identifier in [one for one, since in self._over.items() if now - since > FORGET_S]:
                del self._over[identifier]
                self._seats = {key: pair for key, pair in self._seats.items() if pair[0].id != identifier}

    # Worlds

    async def create(
        self, owner: str, make_order: Callable[[str], WorldOrder], rules: WorldRules, request: Repeatable
    ) -> str:
        """Starts a world and waits for its first tick; returns its identifier.

        Args:
            owner: Owner of the world.
            make_order: Order of a world with a given identifier.
            rules: What the server does with it.
            request: What identifies the same request when it is sent again; its world is returned then.

        Raises:
            TooManyRequestsError: The owner has too many worlds.
            BusyError: There are too many worlds, the simulation cannot be started, or the service is ending.
            InvalidInputError: The scenario cannot be simulated.
        """
        if before := await asyncio.to_thread(self._made_before, owner, request):
            return before
        self._check_room(owner)
        identifier = new_id("wo")
        process = EpisodeProcess(self._settings.policies, ENTRY)
        order = make_order(identifier)
        world = self._live[identifier] = LiveWorld(identifier, owner, order, process, rules, self._loop)
        added = asyncio.create_task(asyncio.to_thread(self._add, world, rules, request))
        try:
            before = await asyncio.shield(added)
            await process.start()
            self._check_goes_on()  # whatever begins now, `stop` would not know of
        except BaseException as error:
            del self._live[identifier]
            await asyncio.shield(self._undo(identifier, added, process))
            if isinstance(error, OSError):
                raise BusyError(f"no process could be started: {error}") from error
            raise
        if before is not None:  # the same request came twice at once
            del self._live[identifier]
            await process.close()
            return before
        task = self._tasks[identifier] = asyncio.create_task(self._run(world, process))
        try:
            await world.simulation.wait()
        except BusyError as error:
            world.ending = str(error)  # what is logged of it
            task.cancel()
            await asyncio.wait([task])
            await asyncio.to_thread(self._remove, identifier)  # else the same request would get it again
            raise
        if task.done() or identifier not in self._live:
            await self._refuse(identifier, await task)
        return identifier

    def _check_goes_on(self) -> None:
        if self._stopping:
            raise BusyError("the service is ending")

    def _check_room(self, owner: str) -> None:
        self._check_goes_on()
        most = self._settings.worlds_per_owner
        if sum(world.owner == owner for world in self._live.values()) >= most:
            raise TooManyRequestsError(f"expected at most {most} live worlds of one owner; end one", retry_s=60)
        if len(self._live) >= self._settings.worlds:
            raise BusyError(f"the service has its {self._settings.worlds} worlds", retry_s=60)

    def _made_before(self, owner: str, request: Repeatable) -> str | None:
        with self._database.reading() as session:
            return _existing(session, owner, request)

    def _add(self, world: LiveWorld, rules: WorldRules, request: Repeatable) -> str | None:
        """Stores a new world; returns the identifier of the one that the same request has made meanwhile."""
        with self._database.session() as session:
            serialise(session)
            if before := _existing(session, world.owner, request):
                return before
            check_bytes(session, world.owner, self._settings.bytes_per_owner)
            if queries.count_worlds(session, world.owner) >= queries.KEPT_PER_OWNER:
                raise TooManyRequestsError(f"at most {queries.KEPT_PER_OWNER} worlds; delete some", retry_s=3600)
            document = world.order.model_dump(mode="json", exclude={"name", "directory"})
            told = rules.model_dump(mode="json") | {"record": world.order.directory is not None}
            session.add(World(id=world.id, owner=world.owner, order=document | told))
            remember(session, world.owner, *request, world.id)
        return None

    async def _refuse(self, identifier: str, outcome: Outcome) -> None:
        """Raises the reason for which a world did not begin."""
        await asyncio.to_thread(self._remove, identifier)  # else the same request would get it again
        if outcome.end is not End.IMPOSSIBLE:
            raise BusyError(f"the world could not be started: {outcome.text}")
        raise InvalidInputError(f"scenario: {outcome.text}")

    async def _undo(self, identifier: str, added: asyncio.Task[str | None], process: EpisodeProcess) -> None:
        """Leaves nothing of a world that did not begin, wherever its beginning was broken off."""
        await asyncio.wait([added])
        await process.close()
        await asyncio.to_thread(self._remove, identifier)

    def _remove(self, identifier: str) -> None:
        with self._database.session() as session:
            if (row := session.get(World, identifier)) is not None:
                session.delete(row)

    async def _run(self, world: LiveWorld, process: EpisodeProcess) -> Outcome:
        """Lets a world live, and stores how it ends."""
        try:
            outcome = await process.drive(world.order)
        except asyncio.CancelledError:
            outcome = Outcome(End.STOPPED, f"{world.ending or 'the service ended'}; its process took too long to end")
        finally:
            await asyncio.shield(process.close())
        if outcome.end is End.FINISHED:
            world.simulation.tick, world.simulation.time_s, _ = SHOWN.unpack(outcome.last)
            status, reason = (WorldStatus.ENDED, world.ending) if world.ending else (WorldStatus.DONE, None)
        else:
            status, reason = WorldStatus.FAILED, outcome.text[:2000]
            logger.warning("world %s failed: %s", world.id, reason)
        world.lockstep.status = status
        try:
            await asyncio.to_thread(self._store, world, reason)
        except Exception:  # the next start of the service says that it failed
            logger.exception("world %s: its end cannot be stored", world.id)
        finally:
            del self._live[world.id], self._tasks[world.id]
            self._over[world.id] = self._loop.monotonic()
            world.over(reason or "all egos have ended their drives")
        return outcome

    def _store(self, world: LiveWorld, reason: str | None) -> None:
        record: tuple[str, int] | None = None
        clock, simulation, status = world.lockstep.clock, world.simulation, world.lockstep.status
        if world.order.directory is not None and status is not WorldStatus.FAILED:
            path = record_path(self._settings, world.id)
            record = read_record(path).record_hash, record_size(path)
        run = {"seed": simulation.seed, "resets": simulation.resets}
        told = run | {"overruns": clock.overruns, "pace": clock.pace, "speed": clock.speed}
        with self._database.session() as session:
            queries.finish_world(session, world.id, status, reason, simulation.tick, record)
            row = session.get_one(World, world.id)
            row.order = row.order | told

    def find(self, identifier: str, *, heard: bool = True) -> LiveWorld | None:
        """A live world; `heard`: this counts as a request to it."""
        world = self._live.get(identifier)
        if world is not None and heard:
            world.heard = self._loop.monotonic()
        return world

    def end_later(self, world: LiveWorld, why: str) -> None:
        """Ends a world; its process is killed where it takes too long for that."""
        world.end(why)
        asyncio.get_running_loop().call_later(END_S, self._kill, world.id)

    def _kill(self, identifier: str) -> None:
        """Kills the process of a world that still lives; what follows on its end is done as ever."""
        if (world := self._live.get(identifier)) is not None:
            world.kill()

    async def ended(self, identifier: str) -> None:
        """Waits until a world has ended."""
        if (task := self._tasks.get(identifier)) is not None:
            await asyncio.wait([task], timeout=END_S)

    # Seats

    def add_seat(self, world: LiveWorld, seat: Seat) -> None:
        """Makes a seat known by its identifier; of those that have ended, each with its last reply, a few are kept."""
        left = [key for key, (of, one) in self._seats.items() if of is world and one.ended]
        for key in left[:-ENDED_SEATS]:
            del self._seats[key]
        self._seats[seat.id] = (world, seat)

    def seat_of(self, identifier: str, token: str) -> tuple[LiveWorld, Seat]:
        """A seat and its world, by its identifier and its secret.

        Raises:
            UnauthorisedError: There is no such seat with this secret.
        """
        world, seat = self._seats.get(identifier, (None, None))
        if world is None or seat is None or not secrets.compare_digest(seat.token.encode(), token.encode()):
            raise UnauthorisedError("expected the token of this seat; join the world again")
        if not seat.ended:
            world.heard = self._loop.monotonic()
        return world, seat

    def token_ids(self) -> set[str]:
        """API tokens with which workers joined, and spectators watch."""
        seated = {seat.token_id for world in self._live.values() for seat in world.seats}
        return seated.union(*(world.audience.token_ids for world in self._live.values()))

    def dismiss(self, token_id: str) -> None:
        """Takes the seats of the workers of an API token that is no longer valid, and ends what spectators watch."""
        for world in self._live.values():
            world.audience.dismiss(lambda spectator: spectator.token_id == token_id)
            for seat in [one for one in world.seats if one.token_id == token_id]:
                world.leave(seat, "the token of the worker is no longer valid")


def _existing(session: Session, owner: str, request: Repeatable) -> str | None:
    """World that the same request has made before, unless it was refused or deleted since."""
    made = made_before(session, owner, *request)
    return made if made is not None and session.get(World, made) is not None else None
