"""Freeway mornings with a policy worker as planner: one process each, with its result in a file.

They are no evaluations: nothing of them is ranked. A morning waits until a worker of its agent asks for an episode; a
worker that vanishes costs an attempt, and after two the morning is lost.
"""

from __future__ import annotations

import asyncio
import json
import logging
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dohyo.evaluation.freeway.benchmark import TrafficBenchmark
from dohyo.service.database.base import new_id
from dohyo.service.errors import NotFoundError, TooManyRequestsError
from dohyo.service.freeway.order import FreewayOrder
from dohyo.service.running.process import End, EpisodeProcess, Outcome
from dohyo.service.running.remote import SEEN
from dohyo.service.settings import Settings
from dohyo.service.workers.lease import RemoteEpisode
from dohyo.sumo_networks.files import write_atomically

if TYPE_CHECKING:
    from dohyo.service.scheduling.scheduler import Scheduler

PROGRAM = "dohyo.service.freeway.child"
VERSION = 1
"""Mornings are of no submission; a worker that takes only another version gets none."""
MAX_ATTEMPTS, LOOK_S = 2, 0.2

_NAME = re.compile(r"fm-[0-9a-f]{16}")

logger = logging.getLogger("dohyo.service")


@dataclass(eq=False, slots=True)
class Live:
    """A morning that waits or runs.

    Attributes:
        order: Order of the morning.
        task: Task that drives it.
        episode: Episode for a worker, once the process runs.
    """

    order: FreewayOrder
    task: asyncio.Task[None] | None = None
    episode: RemoteEpisode | None = None

    @property
    def status(self) -> str:
        """Public state of the morning."""
        return "running" if self.episode is not None and self.episode.held else "waiting"


class FreewayMornings:
    """All mornings. Lives on the event loop; results are on disk."""

    def __init__(self, settings: Settings, scheduler: Scheduler) -> None:
        self._settings, self._scheduler = settings, scheduler
        self._live: dict[str, Live] = {}

    def begin(self, benchmark: TrafficBenchmark, seed: int, agent: str, owner: str) -> str:
        """Accepts an order and returns the name of its morning.

        Raises:
            TooManyRequestsError: The largest number of live mornings is reached.
        """
        if len(self._live) >= self._settings.remote_episodes:
            raise TooManyRequestsError(
                f"expected at most {self._settings.remote_episodes} mornings at once", retry_s=60
            )
        name = new_id("fm")
        order = FreewayOrder(benchmark=benchmark, seed=seed, agent=agent, act_deadline_s=self._settings.act_deadline_s)
        self._folder.mkdir(parents=True, exist_ok=True)
        self._write(name, order, owner, "waiting")
        live = self._live[name] = Live(order)
        live.task = asyncio.create_task(self._drive(name, live, owner))
        return name

    def read(self, name: str) -> dict[str, Any]:
        """State of a morning, with its owner.

        Raises:
            NotFoundError: There is none of that name.
        """
        path = self._folder / f"{name}.json"
        if not _NAME.fullmatch(name) or not path.is_file():
            raise NotFoundError(f"no morning '{name[:40]}'")
        document: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        live = self._live.get(name)
        if document["status"] == "waiting":
            document["status"] = live.status if live is not None else "lost"
        return document

    async def stop(self) -> None:
        """Ends all mornings; unfinished ones are lost."""
        tasks = [live.task for live in self._live.values() if live.task is not None]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    @property
    def _folder(self) -> Path:
        return self._settings.data / "freeway"

    async def _drive(self, name: str, live: Live, owner: str) -> None:
        attempt, outcome = 1, Outcome(End.FAILED, "it was never begun")
        try:
            while attempt <= MAX_ATTEMPTS:
                await self._wanted(live)
                outcome = await self._in_process(live, attempt)
                if outcome.end in (End.FINISHED, End.IMPOSSIBLE):
                    break
                logger.warning("morning %s, attempt %d: %s", name, attempt, outcome.text)
                attempt += outcome.end is not End.UNCLAIMED
                live.episode = None
            if outcome.end is End.FINISHED:
                self._write(name, live.order, owner, **json.loads(outcome.last[SEEN.size :]))
            else:
                status = "failed" if outcome.end is End.IMPOSSIBLE else "lost"
                self._write(name, live.order, owner, status, outcome.text)
        except OSError as error:
            logger.error("morning %s: %s", name, error)
        finally:
            del self._live[name]

    async def _wanted(self, live: Live) -> None:
        """Waits for a free worker of the agent that no other morning has reserved."""
        leases, agent = self._scheduler.leases, live.order.agent
        while True:
            coming = sum(
                one.episode is not None and not one.episode.held and one.order.agent == agent
                for one in self._live.values()
            )
            if leases.demand(agent, VERSION) > coming:
                return
            await asyncio.sleep(LOOK_S)

    async def _in_process(self, live: Live, attempt: int) -> Outcome:
        leases = self._scheduler.leases
        process = EpisodeProcess(self._settings.policies, PROGRAM)
        live.episode = RemoteEpisode(live.order.agent, VERSION, attempt, live.order, process)
        outcome = aborted = Outcome(End.STOPPED, "the service ends")
        try:
            await process.start()
            leases.expect(live.episode)
            outcome = await process.drive(live.order)
        except OSError as error:
            outcome = Outcome(End.FAILED, f"no process could be started: {error}")
        finally:
            leases.ended(live.episode, outcome, "abort" if outcome is aborted and live.episode.frame else "run")
            process.kill()
            await asyncio.shield(process.close())
        return outcome

    def _write(
        self,
        name: str,
        order: FreewayOrder,
        owner: str,
        status: str,
        detail: str = "",
        outcome: dict[str, float | None] | None = None,
    ) -> None:
        document = order.facts() | {"owner": owner, "status": status, "detail": detail, "outcome": outcome}
        write_atomically(self._folder / f"{name}.json", (json.dumps(document, indent=1) + "\n").encode())
