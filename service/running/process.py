"""EpisodeProcess: the server's handle of one process that drives episodes.

libsumo lives only there. The process is kept from episode to episode; it dies with the server, and the server notices
its death, and the hanging of an agent in it, without ever waiting for it.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Final

from dohyo.evaluation.running.job import KILL_GRACE_S, NEVER_RETURNED, POLL_S
from dohyo.service.confinement.environment import of_episodes, without_secrets
from dohyo.service.forking.process import ForkedProcess
from dohyo.service.forking.server import Launch, Template, fork
from dohyo.service.running.channel import Frames, Kind
from dohyo.service.running.gauge import GAUGE_BYTES, Gauge
from dohyo.service.shielding import to_the_end
from dohyo.sumo_networks.config import Config

ENTRY: Final = "dohyo.service.running.child:drive_here"
TEMPLATE: Final = Template("dohyo.service.running.child:prepare")


class End(StrEnum):
    """End of an order.

    FINISHED: the record is on disk. IMPOSSIBLE: the order can never be driven. HUNG: the agent never returned.
    FAILED: SUMO failed, or the disk. DIED: the machine ended the process. WORKER_GONE, GIVEN_BACK: the policy worker
    left the episode. UNCLAIMED: no policy worker came. STOPPED: the evaluation or the service ended.
    """

    FINISHED = "finished"
    IMPOSSIBLE = "impossible"
    HUNG = "hung"
    FAILED = "failed"
    DIED = "died"
    WORKER_GONE = "worker_gone"
    GIVEN_BACK = "given_back"
    UNCLAIMED = "unclaimed"
    STOPPED = "stopped"


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of an order.

    Attributes:
        end: Kind of the end.
        text: Reason, where it did not finish.
        ego: Of an agent that never returned, or was called when the process died: number of an ego that it drives.
        in_call: Whether an agent was called when the process died.
        last: Of a remote episode that finished: its last tick, as `remote.SEEN`, and further bytes of its program.
    """

    end: End
    text: str = ""
    last: bytes = b""
    ego: int = 0
    in_call: bool = False


class EpisodeProcess:
    """A process for one order at a time.

    Attributes:
        alive: Whether it can take an order.
        processor_s: Processor time of the process and of those that it started, since its start, s.
        seen: Called with every frame of a remote episode or a world: observations, refused actions, scenes.
    """

    def __init__(self, policies: Path, entry: str = ENTRY, cluster: str | None = None) -> None:
        """Creates the handle; `start` starts the process.

        Args:
            policies: Folder of uploaded policies.
            entry: "module:function" that runs in it.
            cluster: Address of the Ray cluster that drives for it; None: it drives itself.
        """
        self._policies, self._entry, self._cluster = policies, entry, cluster
        self.alive, self.processor_s = False, 0.0
        self.seen: Callable[[Kind, bytes], None] = lambda kind, payload: None
        self._frames = Frames(self._received, self._gone)
        self._process: subprocess.Popen[bytes] | ForkedProcess | None = None
        self._ending: asyncio.Future[Outcome] | None = None
        self._gauge: Gauge | None = None
        self._limit_s = math.inf

    async def start(self) -> None:
        """Starts the process; a cancellation waits for it and ends it.

        Raises:
            OSError: The process cannot be started.
        """
        try:
            await to_the_end(self._start())
        except BaseException:
            await to_the_end(self.close())
            raise

    async def _start(self) -> None:
        ours, theirs = socket.socketpair()
        await asyncio.get_running_loop().create_unix_connection(lambda: self._frames, sock=ours)
        self._process = await asyncio.to_thread(self._spawn, theirs)
        self.alive = True

    def _spawn(self, theirs: socket.socket) -> subprocess.Popen[bytes] | ForkedProcess:
        """Starts the process with the other end of the channel, which is closed here; blocks until it exists.

        Descriptors belong to this thread alone: closed elsewhere, their numbers would soon be those of other files.
        """
        with theirs, tempfile.TemporaryFile() as shared:
            shared.truncate(GAUGE_BYTES)
            self._gauge = Gauge(shared.fileno())
            return self._launch(theirs.fileno(), shared.fileno())

    def _launch(self, channel: int, gauge: int) -> subprocess.Popen[bytes] | ForkedProcess:
        policies = {"DOHYO_POLICIES": str(self._policies.resolve())}
        if self._cluster is None:
            environment = of_episodes() | policies
            path = [os.getcwd(), *filter(None, sys.path)]
            launch = Launch(self._entry, "dohyo-episode", environment, Path.cwd(), path)
            return fork(TEMPLATE, environment, launch, (channel, gauge))
        return subprocess.Popen(
            [sys.executable, "-m", "dohyo.service.running.child", str(channel), str(gauge), self._cluster],
            pass_fds=(channel, gauge),
            stdin=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C goes to the server, which ends its processes itself
            env=without_secrets() | policies,  # a cluster's client needs variables that only its administrator knows
        )

    async def drive(self, order: Config, limit_s: float = math.inf) -> Outcome:
        """Drives one order to its end; a cancellation ends the process.

        Args:
            order: Order to drive, of an episode or of a world.
            limit_s: Wall-clock limit of the simulation, s; beyond it the machine has failed. The agent's decisions may
                take half as much beside it; beyond that the agent has failed.
        """
        assert self._gauge is not None
        self._ending = asyncio.get_running_loop().create_future()
        self._gauge.clear()
        self._limit_s = limit_s
        self._frames.send(Kind.ORDER, order.model_dump_json().encode())
        try:
            while not self._ending.done():
                await asyncio.wait({self._ending}, timeout=POLL_S)
                if not self._ending.done():
                    self._check()
            return self._ending.result()
        except asyncio.CancelledError:
            self.kill()
            raise
        finally:
            self._measure()
            self._ending = None
            self.seen = lambda kind, payload: None

    def send(self, kind: Kind, payload: bytes = b"") -> None:
        """Sends a frame to a remote episode."""
        self._frames.send(kind, payload)

    def kill(self, why: Outcome | None = None) -> None:
        """Ends the process at once; its order ends as given."""
        if why is not None:
            self._end(why)
        self.alive = False
        if self._process is not None and self._process.returncode is None:
            with contextlib.suppress(ProcessLookupError):  # with all that it has started
                os.killpg(self._process.pid, signal.SIGKILL)
        self._frames.close()

    async def close(self) -> None:
        """Ends the process and waits until it is gone."""
        self.kill()
        if self._process is not None:
            await asyncio.to_thread(self._process.wait)

    def _check(self) -> None:
        """Checks whether the agent hangs or the process has died."""
        self._measure()
        gauge, now, limit_s = self._gauge, time.monotonic(), self._limit_s
        assert gauge is not None
        if gauge.due > 0.0 and now > gauge.due + KILL_GRACE_S:
            self.kill(Outcome(End.HUNG, NEVER_RETURNED, ego=gauge.ego))
        elif gauge.agent_s > limit_s / 2:
            text = f"agent took more than {limit_s / 2:g} s for the decisions of one episode"
            self.kill(Outcome(End.HUNG, text, ego=gauge.slowest))
        elif gauge.began > 0.0 and now - gauge.began - gauge.agent_s - gauge.deciding_s > limit_s:
            # Its agent's time is apart: else a slow agent could make its drive a fault of the machine.
            text = f"simulation took more than {limit_s:g} s; its agent took {gauge.agent_s:.0f} s"
            self.kill(Outcome(End.FAILED, text))
        elif self._process is None or self._process.poll() is not None:
            self._gone()

    def _measure(self) -> None:
        """Reads the processor time; a process that is gone keeps the last reading."""
        if self._process is not None:
            with contextlib.suppress(OSError):
                self.processor_s = processor_time_s(self._process.pid)

    def _received(self, kind: Kind, payload: bytes) -> None:
        if kind in (Kind.SEEN, Kind.REFUSED, Kind.STAGE, Kind.SCENE):
            self.seen(kind, payload)
        elif kind is Kind.FINISHED:
            self._end(Outcome(End.FINISHED, last=payload))
        elif kind is Kind.IMPOSSIBLE:
            self._end(Outcome(End.IMPOSSIBLE, payload.decode()))
        else:
            self._end(Outcome(End.FAILED, payload.decode()))

    def _gone(self) -> None:
        self.alive = False
        code: int | None = None
        if self._process is not None:
            with contextlib.suppress(subprocess.TimeoutExpired):
                code = self._process.wait(0.05)  # the channel closes shortly before the process ends
        ego, in_call = (0, False) if self._gauge is None else (self._gauge.ego, self._gauge.due > 0.0)
        self._end(Outcome(End.DIED, f"episode process ended with code {code}", ego=ego, in_call=in_call))
        self.kill()

    def _end(self, outcome: Outcome) -> None:
        if self._ending is not None and not self._ending.done():
            self._ending.set_result(outcome)


def processor_time_s(pid: int) -> float:
    """Processor time of a process and of its ended children, s.

    Raises:
        OSError: There is no such process.
    """
    after_name = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    return sum(map(int, after_name[11:15])) / os.sysconf("SC_CLK_TCK")  # utime, stime, cutime, cstime; see proc(5)
