"""What the lease book writes down: workers, episodes that workers drive, and who holds which."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field

from dohyo.service.episodes.freeway_order import FreewayOrder
from dohyo.service.episodes.order import EpisodeOrder
from dohyo.service.episodes.process import EpisodeProcess
from dohyo.service.wire import Reply


@dataclass(slots=True)
class Worker:
    """A policy worker.

    Attributes:
        id: In paths.
        token: What it proves itself with.
        agent: Whose episodes it drives.
        owner: Of the agent.
        token_id: The API token it registered with.
        version: Of the agent; None: whichever.
        capacity: Episodes at once.
        seen: When it last said anything, monotonic.
        leases: It holds.
        polls: Its requests for an episode that wait now.
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
        """Whether an episode is for it."""
        return self.agent == episode.agent and self.version in (None, episode.version)


@dataclass(eq=False, slots=True)
class RemoteEpisode:
    """An episode in a process that waits for a worker, or is held by one.

    Attributes:
        agent: Name of the agent.
        version: Of its submission.
        attempt: From 1.
        order: What is driven.
        process: Where.
        offered: When it could first be given to a worker, monotonic; None: not yet.
        frame: What the worker is to see next, as the process sent it.
        held: Whether a worker has it.
        stepped: Whether a worker has driven any of it.
        returned: How often workers gave it back untouched.
        blameless: Whether its end was not even an attempt: no worker has seen it.
    """

    agent: str
    version: int
    attempt: int
    order: EpisodeOrder | FreewayOrder
    process: EpisodeProcess
    offered: float | None = None
    frame: bytes = b""
    held: bool = False
    stepped: bool = False
    returned: int = 0
    blameless: bool = False


@dataclass(eq=False, slots=True)
class Lease:
    """A worker's hold on an episode.

    Attributes:
        id: In paths; the fence.
        worker: Who holds it.
        episode: What is held.
        tick: Last shown to the worker.
        answered: The tick that `reply` answers; -1: none.
        reply: The last one, for whoever asks again.
        waiting: Requests for the reply to `tick`; the simulation moves while there are any.
        heard: When the worker last said anything, monotonic.
        due: When its decision is due, monotonic.
        moving: Since when the simulation has had the worker's decision; None: it is the worker's turn.
        refused: Whether the worker's last answer could not be taken.
        ended: Why it is no more; "" while it is held.
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
