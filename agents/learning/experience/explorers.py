"""Explorers: processes that drive by a copy of the policy, each on its own, while the learner updates.

With a `Collector` the learner chooses every action, and all rows wait for the slowest one at every step. An explorer
drives a stretch of steps by the policy of the stretch's beginning, as the actors of Horgan et al. (2018) and the
producers of GRIAD do, and the learner waits once for all stretches. These are counted in steps and never in time, and
come in by the explorers' numbers, so that a run is the same whoever is ready first.
"""

from __future__ import annotations

import io
import logging
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Protocol

import numpy as np
import torch
from tensordict import TensorDict

from dohyo.agents.learning.experience.behaviour import Behaviour, EpisodeMixture
from dohyo.agents.learning.experience.collector import MAX_LOST, Collector, Finished
from dohyo.agents.learning.tasks.curriculum import Progress
from dohyo.agents.learning.tasks.environments import check_environments
from dohyo.agents.learning.tasks.task import Environments, Task
from dohyo.sumo_networks.envs.worker_process import Host, WorkerDeathError, WorkerProcess
from dohyo.sumo_networks.errors import InvalidInputError, SimulationError

logger = logging.getLogger(__name__)

_ACTIONS = 3  # separates this random stream from those of seeds, mixtures and demonstrations


class Worker(Protocol):
    """Where an explorer lives, see `WorkerProcess`; `receive` must follow every `send`."""

    def send(self, command: str, *arguments: Any) -> None:
        """Begins a command of the host; makes a new host where the last one has been stopped."""

    def receive(self) -> Any:
        """Waits for its end; raises WorkerDeathError if the host is gone, or what the command raised."""

    def begin_stop(self) -> None:
        """Tells the host to end."""

    def stop(self) -> None:
        """Ends the host."""


MakeWorker = Callable[[int, Callable[[], Host]], Worker]
"""Makes a worker of its number and of what makes its host."""


@dataclass(frozen=True, slots=True)
class Order:
    """What an explorer is to drive.

    Attributes:
        number: Of the stretch; with the run's seed and the explorer it decides all that is drawn.
        steps: Length of the stretch.
        cut: Whether its last step cuts the running episode.
        behaviour: That drives, see `packed`.
        state: Of its collector, for an explorer that begins anew; None: it goes on.
        part: Of a stretch that is driven step by step, from 1; 0: it is driven as a whole.
    """

    number: int
    steps: int
    cut: bool
    behaviour: bytes
    state: Mapping[str, Any] | None
    part: int = 0


@dataclass(frozen=True, slots=True)
class Stretch:
    """What an explorer has driven.

    Attributes:
        steps: (T, 1) steps, see `Collector.receive`.
        finished: Episodes that have ended.
        state: Of its collector.
    """

    steps: TensorDict
    finished: Sequence[Finished]
    state: Mapping[str, Any]


class Explorer:
    """One explorer, in its process: an environment with a collector of its own."""

    def __init__(self, task: Task, seed: int, rank: int, count: int) -> None:
        """Prepares; the environment is made with the first stretch, whose answer tells why it cannot be.

        Args:
            task: Of it.
            seed: Of the run.
            rank: Number of the explorer, from 0.
            count: Number of all explorers.
        """
        self._task, self._seed, self._rank, self._count = task, seed, rank, count
        self._environments: Environments | None = None

    def carry_out(self, command: str, *arguments: Any) -> Any:
        """See `Host`; the only command is "drive"."""
        assert command == "drive", command
        return self.drive(*arguments)

    def drive(self, order: Order) -> Stretch:
        """Drives a stretch."""
        if self._environments is None:
            self._begin()
        collector = self._collector
        if order.state is not None:
            collector.restore(order.state)
        drawn = np.random.default_rng([_ACTIONS, self._seed, self._rank, order.number, order.part])
        torch.manual_seed(int(drawn.integers(2**63)))
        behaviour: Behaviour = torch.load(io.BytesIO(order.behaviour), map_location="cpu", weights_only=False)
        collector.cut_at = int(order.cut)
        steps = [collector.step(behaviour) for _ in collector.round(order.steps)]
        return Stretch(TensorDict.stack(steps), collector.finished(), collector.state())

    def close(self) -> None:
        """See `Host`."""
        if self._environments is not None:
            self._environments.close()

    def _begin(self) -> None:
        torch.set_num_threads(1)
        environments = self._task.make_environments(1, processes=False)
        check_environments(environments)
        numbers = slice(self._rank, None, self._count)
        self._collector = Collector(environments, self._task, self._seed, numbers=numbers)
        self._environments = environments


class Explorers:
    """N explorers, as one source of steps for an off-policy learner; see the module and `Collector`.

    An explorer whose process dies loses its episode. It begins the stretch anew in a new process.

    Attributes:
        action_space: Space of one action.
        cut_at: The first round that ends at this number of steps or later ends with a cut.
        cut: Whether the last step ended with a cut: a checkpoint can be written now.
    """

    def __init__(
        self, task: Task, seed: int, count: int, stretch: int, make_worker: MakeWorker = WorkerProcess
    ) -> None:
        """Starts the processes.

        Args:
            task: What is learned.
            seed: Of the run.
            count: Number of explorers.
            stretch: Steps that each drives on its own.
            make_worker: Where they live.

        Raises:
            InvalidInputError: The task has a curriculum, whose levels explorers cannot share.
        """
        if task.curriculum is not None:
            raise InvalidInputError(f"task '{task.name}' has a curriculum: expected one without, or explorers = 0")
        self.action_space = task.action_space
        self.cut_at, self.cut = 0, True
        self._task, self._seed, self._length, self._count = task, seed, stretch, count
        self._workers: list[Worker] = []
        self._finalizer = weakref.finalize(self, _stop_all, self._workers)
        self._workers += [make_worker(rank, partial(Explorer, task, seed, rank, count)) for rank in range(count)]
        self._states: list[dict[str, Any]] = [_beginning(rank) for rank in range(count)]
        self._anew = set(range(count))  # explorers whose collectors have to be given their state
        self._number, self._deaths, self._left = 0, 0, 0
        self._orders: list[Order] = []
        self._finished: list[Finished] = []

    def __len__(self) -> int:
        return self._count

    @property
    def steps(self) -> int:
        """Taken so far, of all explorers together."""
        return sum(int(state["steps"]) for state in self._states)

    @property
    def finished_count(self) -> int:
        """Episodes that have ended."""
        return sum(int(state["finished"]) for state in self._states)

    @property
    def lost_count(self) -> int:
        """Episodes whose simulation failed, or whose process died."""
        return self._deaths + sum(int(state["lost"]) for state in self._states)

    def round(self, length: int) -> range:
        """Begins a round of `length` steps of every explorer; to be iterated over, by stretches."""
        self._left = length
        return range(-(-length // self._length))

    def send(self, behaviour: Behaviour) -> None:
        """Begins a stretch of all explorers by the present policy.

        Raises:
            InvalidInputError: The behaviour cannot be sent, or remembers episodes.
        """
        sent, steps = packed(behaviour), min(self._length, self._left)
        self._left -= steps
        self.cut = self._left == 0 and 0 < self.cut_at <= self.steps + self._count * steps
        self._orders = [
            Order(self._number, steps, self.cut, sent, state if rank in self._anew else None)
            for rank, state in enumerate(self._states)
        ]
        self._number += 1
        self._anew.clear()
        for worker, order in zip(self._workers, self._orders, strict=True):
            worker.send("drive", order)

    def received(self) -> Iterator[TensorDict]:
        """Waits for the stretches.

        Returns:
            (N,) steps in their order; see `Collector.receive`.

        Raises:
            EnvError: The task's code failed.
            SimulationError: Simulations fail, or processes die, again and again.
        """
        try:
            stretches = [self._stretch(rank) for rank in range(self._count)]
        except BaseException:  # pending answers would be taken for answers to the next command
            self.close()
            raise
        self._states = [dict(stretch.state) for stretch in stretches]
        for rank, stretch in enumerate(stretches):
            self._finished += [episode._replace(row=rank) for episode in stretch.finished]
        yield from torch.cat([stretch.steps for stretch in stretches], dim=1).unbind(0)

    def finished(self) -> list[Finished]:
        """Hands over the episodes that have ended since the last call."""
        finished, self._finished = self._finished, []
        return finished

    def state(self) -> dict[str, Any]:
        """State for `restore`, after a cut."""
        return {"explorers": self._states, "stretches": self._number, "deaths": self._deaths}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restores a state; new episodes begin with the next step.

        Raises:
            InvalidInputError: It is that of another number of explorers, or of a collector.
        """
        states = state.get("explorers", ())
        if len(states) != self._count:
            raise InvalidInputError(f"checkpoint: expected one of {self._count} explorers, got {len(states)}")
        self._states, self._anew = [dict(one) for one in states], set(range(self._count))
        self._number, self._deaths, self.cut = state["stretches"], state["deaths"], True

    def close(self) -> None:
        """Ends the processes."""
        self._finalizer()

    def _stretch(self, rank: int) -> Stretch:
        """An explorer's answer; where it has died, that of the stretch driven anew in a new process, step by step."""
        order = self._orders[rank]
        try:
            answer: Stretch = self._workers[rank].receive()
        except WorkerDeathError as error:
            self._lose(rank, error)
        else:
            return answer
        steps, finished, state, fresh = list[TensorDict](), list[Finished](), self._states[rank], True
        for part in range(1, order.steps + 1):
            cut = order.cut and part == order.steps
            one = self._step(rank, replace(order, steps=1, part=part, cut=cut, state=None), state, fresh)
            steps, finished, state, fresh = [*steps, one.steps], [*finished, *one.finished], dict(one.state), False
        return Stretch(torch.cat(steps), finished, state)

    def _step(self, rank: int, order: Order, state: Mapping[str, Any], fresh: bool) -> Stretch:
        """One step of an explorer; whoever dies in it goes on with the next episode but those that died so."""
        worker = self._workers[rank]
        for deaths in range(MAX_LOST):
            skipped = {**state, "next": state["next"] + deaths * self._count}
            worker.send("drive", replace(order, state=skipped if fresh or deaths else None))
            try:
                answer: Stretch = worker.receive()
            except WorkerDeathError as error:
                self._lose(rank, error)
            else:
                return answer
        raise SimulationError(f"task '{self._task.name}': explorer {rank} died {MAX_LOST} times in one step")

    def _lose(self, rank: int, error: WorkerDeathError) -> None:
        logger.warning("explorer %d is lost, and begins anew: %s", rank, error)
        self._deaths += 1
        self._workers[rank].stop()


def packed(behaviour: Behaviour) -> bytes:
    """A behaviour with its policy, to be sent to explorers.

    Raises:
        InvalidInputError: It cannot be sent, or remembers who drives an episode.
    """
    if isinstance(behaviour, EpisodeMixture):
        raise InvalidInputError("explorers: expected a behaviour that chooses each step anew, got EpisodeMixture")
    content = io.BytesIO()
    try:
        torch.save(behaviour, content)
    except Exception as error:  # torch lets through whatever the parts of the behaviour raise
        raise InvalidInputError(f"explorers: the behaviour cannot be sent to another process: {error}") from error
    return content.getvalue()


def _beginning(rank: int) -> dict[str, Any]:
    """State of a collector before its first step."""
    return {"next": rank, "steps": 0, "finished": 0, "lost": 0, "progress": Progress(None).state()}


def _stop_all(workers: Sequence[Worker]) -> None:
    for worker in workers:
        worker.begin_stop()
    for worker in workers:
        worker.stop()
