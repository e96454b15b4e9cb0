"""Entries of the lease book: workers, remote episodes, and leases."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field

from dohyo.service.running.order import EpisodeOrder
from dohyo.service.running.process import EpisodeProcess
from dohyo.service.wire.bodies import Reply


@dataclass(slots=True)
class Worker:
    """A policy worker.

    Attributes:
        id: Identifier in paths.
        token: Secret of its later requests.
        agent: Name of the agent whose episodes it drives.
        owner: Owner of the agent.
        token_id: API token of its registration.
        version: Version of the agent; None: any.
        capacity: Most episodes at once.
        seen: Monotonic time of its last request.
        leases: Leases that it holds.
        polls: Number of its waiting requests for an episode.
    """

    id: str
    token: str
    agent: str
    owner: str
    token_id: str
    version: int | None
    capacity: int
    seen: float
    leases: set[str] = field(default_factory=set)
    polls: int = 0

    def takes(self, episode: RemoteEpisode) -> bool:
        """Whether the worker may drive an episode."""
        return self.agent == episode.agent and self.version in (None, episode.version)


@dataclass(eq=False, slots=True)
class RemoteEpisode:
    """An episode in a process that waits for a worker or is leased to one.

    Attributes:
        agent: Name of the agent.
        version: Version of the submission.
        attempt: Number of the attempt, from 1.
        order: Order that is driven.
        process: Process that drives it.
        offered: Monotonic time of the first offer to workers; None: not yet.
        frame: Next observations for the worker, as the process sent them.
        held: Whether a worker holds it.
        stepped: Whether a worker has sent a step.
    """

    agent: str
    version: int
    attempt: int
    order: EpisodeOrder
    process: EpisodeProcess
    offered: float | None = None
    frame: bytes = b""
    held: bool = False
    stepped: bool = False


@dataclass(eq=False, slots=True)
class Lease:
    """A worker's hold on an episode.

    Attributes:
        id: Identifier in paths; fences older leases.
        worker: Holder of the lease.
        episode: Leased episode.
        tick: Tick last shown to the worker.
        answered: Tick that `reply` answers; -1: none.
        reply: Last reply, for repeated requests.
        waiting: Requests that wait for the reply to `tick`; the simulation runs while there are any.
        heard: Monotonic time of the worker's last request.
        due: Monotonic time by which its decision is due.
        moving: Monotonic time at which the simulation got the decision; None: the worker decides now.
        refused: Whether the worker's last action was invalid.
        ended: Reason of its end; "" while it is held.
    """

    id: str
    worker: Worker
    episode: RemoteEpisode
    heard: float
    due: float
    tick: int = 0
    answered: int = -1
    reply: Reply | None = None
    waiting: list[asyncio.Future[Reply]] = field(default_factory=list)
    moving: float | None = None
    refused: bool = False
    ended: str = ""
