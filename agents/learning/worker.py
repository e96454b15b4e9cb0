"""Environment workers: in-process or subprocess.

gymnasium's and TorchRL's vectors step all of their environments or none, and draw their own seeds. Here a single
environment can be restored from its seed and actions, which exact resumption needs.
"""

from __future__ import annotations

import logging
import multiprocessing
import os
import pickle
import traceback
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from typing import Any, NamedTuple, Protocol

import numpy as np

from dohyo.agents.learning.task import Array, Env, Task
from dohyo.sumo_networks.errors import DohyoError, InvalidInputError, SimulationError

logger = logging.getLogger(__name__)

JOIN_S = 5.0
# The processes of a run fill the cores already; a second thread in each slows all of them down.
ONE_THREAD = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")


class TaskError(DohyoError):
    """The task's own code failed."""


class View(NamedTuple):
    """Result of a reset or a step.

    Attributes:
        observation: Of the task's observation space.
        reward: Of the step; 0 after a reset.
        terminated: The episode ended by itself.
        truncated: It was cut off.
        expert: The expert's action, in the action space; None if it was not asked, or has none.
        success: At the end of an episode: whether it succeeded.
        measures: At the end of an episode: the task's measures.
    """

    observation: Array
    reward: float = 0.0
    terminated: bool = False
    truncated: bool = False
    expert: Array | None = None
    success: bool = False
    measures: Mapping[str, float] | None = None

    @property
    def ended(self) -> bool:
        """Whether this is the last step of its episode."""
        return self.terminated or self.truncated


class Seat(Protocol):
    """One environment; takes one command at a time: `receive` must follow every `send`."""

    def send(self, command: str, *arguments: Any) -> None:
        """Begins "reset" (seed, guided), "step" (action) or "replay" (seed, guided, actions)."""

    def receive(self) -> View:
        """Waits for the end of the command.

        Raises:
            DohyoError: The environment refused; TaskError if its code failed, SimulationError if its process did.
        """

    def renew(self) -> None:
        """Replaces an environment that failed; the new one has to be reset."""

    def close(self) -> None:
        """Ends the environment, and its process."""


@dataclass(slots=True)
class Host:
    """Holds an environment, and executes commands.

    Attributes:
        task: Makes the environment at the first reset.
        seed: Of the run.
        rank: Of the environment.
    """

    task: Task
    seed: int
    rank: int
    _env: Env | None = field(default=None, init=False)
    _guided: bool = field(default=False, init=False)

    def do(self, command: str, arguments: Sequence[Any]) -> View:
        """Executes a command of `Seat.send`.

        Raises:
            TaskError: The task's code failed; its traceback is in the log.
        """
        try:
            view: View = getattr(self, command)(*arguments)
        except DohyoError:
            raise
        except Exception as error:
            what = f"task '{self.task.name}', environment {self.rank}"
            logger.error("%s failed:\n%s", what, traceback.format_exc())
            raise TaskError(f"{what}: {type(error).__name__}: {error}") from error
        return view

    def reset(self, seed: int, guided: bool) -> View:
        """Begins the episode of a seed; with `guided`, the expert is asked at every step."""
        if self._env is None:
            self._env = self.task.make_env(self.seed, self.rank)
        self._guided = guided
        observation, _ = self._env.reset(seed=seed)
        return View(self._checked(observation), expert=self._ask_expert())

    def step(self, action: Array) -> View:
        """Takes one step."""
        if self._env is None:
            raise SimulationError(f"environment {self.rank} of task '{self.task.name}' has not been reset")
        observation, reward, terminated, truncated, info = self._env.step(action)
        value = float(reward)
        if not np.isfinite(value):
            raise TaskError(f"task '{self.task.name}': expected a finite reward, got {value}")
        if not (terminated or truncated):
            return View(self._checked(observation), value, expert=self._ask_expert())
        if missing := [name for name in self.task.measures if name not in info]:
            raise TaskError(f"task '{self.task.name}': the last info of an episode lacks {', '.join(missing)}")
        measures = {name: float(info[name]) for name in self.task.measures}
        success = bool(info.get("success", False))
        return View(self._checked(observation), value, bool(terminated), bool(truncated), None, success, measures)

    def replay(self, seed: int, guided: bool, actions: Sequence[Array]) -> View:
        """Restores an episode; the reward is the sum of all rewards since its reset."""
        view, total = self.reset(seed, guided), 0.0
        for action in actions:
            view = self.step(action)
            total += view.reward
        return view._replace(reward=total)

    def close(self) -> None:
        """Ends the environment."""
        if self._env is not None:
            self._env.close()
            self._env = None

    def _ask_expert(self) -> Array | None:
        if not self._guided or self._env is None:
            return None
        action = self.task.expert(self._env)
        if action is None:
            return None
        action, space = np.asarray(action, dtype=np.float32), self.task.action_space
        if action.shape != space.shape or not np.isfinite(action).all():
            raise TaskError(
                f"task '{self.task.name}': expected of its expert {space.shape} finite numbers, got {action}"
            )
        return action

    def _checked(self, observation: Array) -> Array:
        space = self.task.observation_space
        array = np.array(observation, dtype=space.dtype)  # a copy: the environment may change its own array
        if array.shape != space.shape:
            raise TaskError(f"task '{self.task.name}': expected an observation {space.shape}, got {array.shape}")
        if not np.isfinite(array).all():
            where = np.argwhere(~np.isfinite(array))[:4].tolist()
            raise TaskError(f"task '{self.task.name}': expected finite observations, got others at {where}")
        return array


class HereSeat:
    """An environment in this process."""

    def __init__(self, task: Task, seed: int, rank: int) -> None:
        self._host = Host(task, seed, rank)
        self._pending: tuple[str, tuple[Any, ...]] = ("", ())

    def send(self, command: str, *arguments: Any) -> None:
        """See `Seat`; the command runs in `receive`."""
        self._pending = command, arguments

    def receive(self) -> View:
        """See `Seat`."""
        return self._host.do(*self._pending)

    def renew(self) -> None:
        """See `Seat`."""
        self._host = Host(self._host.task, self._host.seed, self._host.rank)

    def close(self) -> None:
        """See `Seat`."""
        self._host.close()


class ProcessSeat:
    """An environment in a process of its own, which ends with this process in any case."""

    def __init__(self, task: Task, seed: int, rank: int) -> None:
        self._name, self._rank = task.name, rank
        self._arguments = (task, seed, rank)
        self._start()

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs, *self._arguments), daemon=True)
        with _one_thread():
            self._process.start()
        theirs.close()

    def send(self, command: str, *arguments: Any) -> None:
        """See `Seat`."""
        try:
            self._pipe.send((command, arguments))
        except OSError as error:
            raise self._death() from error

    def receive(self) -> View:
        """See `Seat`."""
        try:
            answer = self._pipe.recv()
        except (EOFError, OSError) as error:
            raise self._death() from error
        if isinstance(answer, View):
            return answer
        kind, message = answer
        raised: DohyoError = kind.__new__(kind)  # its constructor may want other arguments
        raised.args = (message,)
        raise raised

    def renew(self) -> None:
        """See `Seat`."""
        self.close()
        self._start()

    def close(self) -> None:
        """See `Seat`."""
        self._pipe.close()
        if self._process.is_alive():
            self._process.join(JOIN_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()

    def _death(self) -> SimulationError:
        self._process.join(JOIN_S)
        code = self._process.exitcode
        return SimulationError(f"environment {self._rank} of task '{self._name}': its process ended with code {code}")


@contextmanager
def _one_thread() -> Iterator[None]:
    """Makes child processes compute with one thread."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _serve(pipe: Connection, task: Task, seed: int, rank: int) -> None:
    """Worker process: executes commands until its parent closes the pipe or ends."""
    os.setsid()  # The parent handles Ctrl-C and signals to the group: it checkpoints, then closes the pipe
    host = Host(task, seed, rank)
    try:
        while True:
            command, arguments = pipe.recv()
            answer: View | tuple[type[DohyoError], str]
            try:
                answer = host.do(command, arguments)
            except DohyoError as error:
                answer = (type(error), str(error))
            pipe.send(answer)
    except (EOFError, OSError):
        host.close()


def take_seats(task: Task, seed: int, processes: int) -> tuple[list[Seat], Seat]:
    """Environment workers of a run: those for training, and the one for held-out episodes.

    Args:
        task: What is learned.
        seed: Of the run.
        processes: Number of training workers, one process each; 0: one in this process, and the one for held-out
            episodes too unless the task is `alone`.

    Raises:
        InvalidInputError: The task cannot be sent to another process.
    """
    kinds: list[type[HereSeat] | type[ProcessSeat]] = [ProcessSeat] * processes or [HereSeat]
    kinds.append(ProcessSeat if processes or task.alone else HereSeat)
    taken: list[Seat] = []
    try:
        taken.extend(kind(task, seed, rank) for rank, kind in enumerate(kinds))
    except (AttributeError, TypeError, pickle.PicklingError) as error:  # what pickle raises
        for seat in taken:
            seat.close()
        raise InvalidInputError(f"task '{task.name}' cannot be sent to another process: {error}") from error
    return taken[:-1], taken[-1]
