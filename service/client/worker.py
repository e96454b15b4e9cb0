"""The worker loop: drives any local agent's episodes for a service until a signal stops it.

The same agent gets the same missions, seeds and observations as in a local evaluation, so the records are the same, to
the hash. A failure of the agent is reported to the service with the text of a local evaluation.
"""

from __future__ import annotations

import logging
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

from dohyo.agents.forecasting.agent import make_forecast_agent
from dohyo.evaluation.agent import Agent, agent_info, close_agent, make_agent
from dohyo.evaluation.episode.deadline import deadline
from dohyo.evaluation.episode.guarded_agent import describe
from dohyo.evaluation.families import FORECASTING_CONTROL, PARKING_CONTROL, OtherFamilyError
from dohyo.evaluation.freeway.day import check_forecast
from dohyo.service.client.connection import LeaseLostError, Pauses, UnreachableError, WireError
from dohyo.service.client.worker_session import Drive, WorkerSession
from dohyo.service.forecasting.interface import forecast_shape
from dohyo.service.forecasting.worker_agent import Predictor
from dohyo.service.parking.interface import check_action as check_parking
from dohyo.sumo_networks.ego.control import InvalidActionError, make_control
from dohyo.sumo_networks.ego.dynamics import VehicleParameters
from dohyo.sumo_networks.errors import AgentError, DohyoError, InvalidInputError
from dohyo.sumo_networks.units import TICK_S

GRACE_S = 1.0  # the service's own deadline comes first
REFUSED = 2  # exit code for bad input
HANG_S = 10.0  # past a lost lease, before a process whose agent never returns ends itself
GIVE_BACK_S = 10.0  # the time in which a process that is told to stop insists on giving its episode back
END_S = 30.0  # from the stop signal until a process that has not ended is killed
TALLY = "DOHYO_WORKER_TALLY"  # variable with the path of a process's tally
INVALID_ACTION = "invalid_action"

logger = logging.getLogger("dohyo.worker")


class _Stop(BaseException):
    """Raised in the main thread by a stop signal."""


@dataclass(frozen=True, slots=True)
class Driver:
    """Agent of a worker.

    Attributes:
        entry: "module:Class" of the agent.
        settings: Arguments of its constructor.
    """

    entry: str
    settings: Mapping[str, Any] = field(default_factory=dict)

    def warm_up(self) -> None:
        """Lets an agent compile what decisions call, for all later agents of this process.

        Raises:
            InvalidInputError: The agent cannot be built, or fails.
        """
        agent = self._make()
        try:
            agent.warm_up()
        except Exception as error:  # an agent may raise anything
            raise InvalidInputError(f"agent '{self.entry}' fails in warm_up: {describe(error)}") from error
        finally:
            close_agent(agent)

    def agents(self, drive: Drive) -> dict[str, Agent]:
        """A fresh agent for each ego of an episode.

        Raises:
            InvalidInputError: The agent cannot be built, or differs from the submitted one.
        """
        made = {ego: self._make() for ego in drive.missions}
        for agent in made.values():
            info = agent_info(agent, self.entry, self.settings)
            wanted = drive.spec
            if [*info.sensors] != [*wanted["sensors"]] or info.control != wanted["control"]:
                raise InvalidInputError(
                    f"agent '{wanted['name']}' was submitted with sensors {wanted['sensors']} and control "
                    f"'{wanted['control']}'; '{self.entry}' here has {[*info.sensors]} and '{info.control}'"
                )
        return made

    def _make(self) -> Agent:
        try:
            return Predictor(make_forecast_agent(self.entry, self.settings))
        except OtherFamilyError:  # most agents; their modules are loaded only once
            pass
        try:
            return make_agent(self.entry, self.settings)
        except OtherFamilyError:
            from dohyo.service.parking.worker_agent import Parker  # loads numba

            return Parker(self.entry, self.settings)


def work(session: WorkerSession, driver: Driver, episodes: int | None = None, tally: Path | None = None) -> None:
    """Drives episode after episode until SIGINT, SIGTERM, or a number of episodes.

    Args:
        session: To drive for.
        driver: Agent that drives.
        episodes: Number of episodes; None: no end.
        tally: File that gets a byte for each episode that was driven; None: none does.

    Raises:
        WireError: The service refuses this worker for good.
        InvalidInputError: The agent differs from the submitted one.
    """
    driven = 0
    with suppress(_Stop), _stopping():
        driver.warm_up()  # before a lease, since the service waits a limited time for the first decision
    with suppress(_Stop), _stopping(), session:
        while episodes is None or driven < episodes:
            drive_episode(session, driver, session.next_drive())
            driven += 1
            if tally is not None:
                with tally.open("ab") as file:
                    file.write(b".")


def drive_episode(session: WorkerSession, driver: Driver, drive: Drive) -> None:
    """Drives one episode to its end or until the lease is lost.

    Raises:
        InvalidInputError: The agent differs from the submitted one; the episode was returned.
    """
    logger.info("episode on lease %s, attempt %d", drive.lease, drive.attempt)
    try:
        agents = driver.agents(drive)
    except (InvalidInputError, _Stop) as error:
        _give_back(session, drive, str(error))
        raise
    try:
        with _heartbeats(session, drive):
            _decide_all(session, agents, drive)
    except LeaseLostError as error:
        logger.warning("%s", error)
    except (UnreachableError, WireError) as error:
        logger.warning("episode given up: %s", error)
    except _Stop as stop:
        _give_back(session, drive, str(stop))
        raise
    finally:
        for agent in agents.values():
            close_agent(agent)


def _decide_all(session: WorkerSession, agents: Mapping[str, Agent], drive: Drive) -> None:
    """Decides tick after tick; a fault of the agent ends the episode with the text of a local evaluation."""
    check = _check_of(drive.spec["control"])
    seconds, started = drive.first_deadline_s, False
    while not drive.done:
        try:
            with deadline(seconds + GRACE_S, "deciding"):
                if not started:
                    for ego, agent in agents.items():
                        agent.reset(drive.missions[ego], drive.seed)
                actions = {ego: agents[ego].act(seen) for ego, seen in drive.observations.items()}
            for action in actions.values():
                check(action)
        except Exception as error:  # an agent may raise anything
            _report(session, drive, error)
            return
        session.step(drive, actions)
        seconds, started = drive.deadline_s, True


def _check_of(control: str) -> Callable[[np.ndarray], object]:
    """Function that raises InvalidActionError for an action that a control cannot take."""
    if control == PARKING_CONTROL:
        return check_parking
    if control == FORECASTING_CONTROL:
        return lambda given: check_forecast(given, forecast_shape())
    return make_control(control, VehicleParameters(), TICK_S).checked


def _report(session: WorkerSession, drive: Drive, error: Exception) -> None:
    """Reports the agent's failure to the service, which knows itself of a decision that came too late."""
    if isinstance(error, InvalidActionError):
        session.release(drive, INVALID_ACTION, str(error))
    else:
        session.release(drive, "the agent failed", str(error) if isinstance(error, AgentError) else describe(error))


def _give_back(session: WorkerSession, drive: Drive, reason: str) -> None:
    with suppress(DohyoError):
        session.release(drive, reason, patience_s=GIVE_BACK_S)


@contextmanager
def _heartbeats(session: WorkerSession, drive: Drive) -> Iterator[None]:
    """Heartbeats during long decisions; ends the process if the agent never returns."""
    over = threading.Event()
    every = session.lease_ttl_s / 3

    def beat() -> None:
        while not over.wait(every / 4):
            if time.monotonic() - session.heard < every:
                continue
            try:
                session.heartbeat(drive)
            except LeaseLostError:
                if not over.wait(HANG_S):
                    logger.error("the agent does not return; this process ends")
                    os._exit(1)
                return
            except DohyoError as error:
                logger.warning("%s", error)

    thread = threading.Thread(target=beat, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()


@contextmanager
def _stopping() -> Iterator[None]:
    """SIGINT and SIGTERM raise `_Stop`, in the main thread."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(number: int, frame: FrameType | None) -> None:
        for one in (signal.SIGINT, signal.SIGTERM):
            signal.signal(one, signal.SIG_IGN)  # an episode is released only once
        raise _Stop("the worker was told to stop")

    before = {one: signal.signal(one, stop) for one in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for one, handler in before.items():
            signal.signal(one, handler)


def shares(episodes: int | None, processes: int) -> list[int | None]:
    """Number of episodes of each process, only of those that drive any; None: no end."""
    if episodes is None:
        return [None] * processes
    each, more = divmod(episodes, processes)
    return [each + (rank < more) for rank in range(min(processes, episodes))]


@dataclass(frozen=True, slots=True)
class _Share:
    """Episodes of one process, over all of its starts.

    Attributes:
        episodes: Number of them; None: no end.
        tally: File with a byte for each one that it has driven.
    """

    episodes: int | None
    tally: Path

    @property
    def left(self) -> int | None:
        """Number of episodes that it still has to drive; None: no end."""
        return None if self.episodes is None else self.episodes - self.tally.stat().st_size

    def start(self, command: Sequence[str], environment: Mapping[str, str]) -> subprocess.Popen[bytes]:
        """Starts the process with what is left."""
        until = [] if self.left is None else ["--episodes", str(self.left)]
        variables = os.environ | environment | {TALLY: str(self.tally)}
        return subprocess.Popen([sys.executable, *command, *until], start_new_session=True, env=variables)


def keep_working(command: Sequence[str], episodes: Sequence[int | None], environment: Mapping[str, str]) -> None:
    """Runs worker processes in parallel, restarts those that die, and ends them at a stop signal.

    A process that is started again drives what is left of its share, or it would wait for episodes that never come.

    Args:
        command: Arguments of the Python command of all processes, without `--episodes`.
        episodes: Share of each process, see `shares`.
        environment: Variables added to the environment of each process.
    """
    crew: dict[subprocess.Popen[bytes], _Share] = {}
    pauses = Pauses()
    with tempfile.TemporaryDirectory(prefix="dohyo-worker-") as folder:
        try:
            with suppress(_Stop), _stopping():
                for rank, number in enumerate(episodes):
                    share = _Share(number, Path(folder, str(rank)))
                    share.tally.touch()
                    crew[share.start(command, environment)] = share
                while crew:
                    time.sleep(0.5)
                    for process in [one for one in crew if one.poll() is not None]:
                        share = crew.pop(process)
                        if process.returncode not in (0, REFUSED) and share.left != 0:
                            time.sleep(pauses.next())
                            crew[share.start(command, environment)] = share
        finally:
            _end(crew)


def _end(crew: Collection[subprocess.Popen[bytes]]) -> None:
    """Ends processes; kills those that do not end, such as in an agent that never returns to the interpreter."""
    for process in crew:
        process.terminate()
    patience = time.monotonic() + END_S
    for process in crew:
        try:
            process.wait(max(patience - time.monotonic(), 0.0))
        except subprocess.TimeoutExpired:
            logger.warning("process %d has not ended in %g s and is killed", process.pid, END_S)
            process.kill()
            process.wait()
