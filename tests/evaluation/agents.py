"""Agents that do one thing wrong each, as strangers' agents do."""

from __future__ import annotations

import asyncio
import ctypes
import multiprocessing
import os
import signal
import sys
import time
from pathlib import Path
from typing import ClassVar

import numpy as np

from dohyo.evaluation.agent import Agent, AgentSpec, Mission, Observation
from dohyo.sumo_networks.errors import SimulationError


class Steady(Agent):
    """Drives along its route at 6 m/s and looks at nobody."""

    spec = AgentSpec(name="steady", sensors=("speedometer",), control="lane_command")

    def __init__(self, after: int = 30) -> None:
        self.after = after
        self.ticks = 0

    def reset(self, mission: Mission, seed: int) -> None:
        self.ticks = 0
        self.seed = seed

    def act(self, observation: Observation) -> np.ndarray:
        self.ticks += 1
        if self.ticks > self.after:
            return self.misbehave()
        return np.array([6.0, 0.0])

    def misbehave(self) -> np.ndarray:
        return np.array([6.0, 0.0])


class Slow(Steady):
    """Takes a second and a half for a short drive, without using the processor."""

    def act(self, observation: Observation) -> np.ndarray:
        time.sleep(0.01)
        return super().act(observation)


class Halting(Steady):
    """Hardly goes on, from the seed on that the environment names."""

    def act(self, observation: Observation) -> np.ndarray:
        if self.seed >= int(os.environ.get("HALTS_FROM", self.seed + 1)):
            time.sleep(1.0)
        return super().act(observation)


class Sluggish(Steady):
    """Takes two seconds for every decision, within any usual deadline."""

    def act(self, observation: Observation) -> np.ndarray:
        time.sleep(2.0)
        return super().act(observation)


class Raises(Steady):
    def misbehave(self) -> np.ndarray:
        raise RuntimeError(f"out of ideas, {self!r}")


class Exits(Steady):
    """Ends its process, as some libraries do."""

    def misbehave(self) -> np.ndarray:
        sys.exit(3)


class ExitsInReset(Steady):
    def reset(self, mission: Mission, seed: int) -> None:
        sys.exit("no such mission")


class Interrupts(Steady):
    def misbehave(self) -> np.ndarray:
        raise KeyboardInterrupt


class IsCancelled(Steady):
    def misbehave(self) -> np.ndarray:
        raise asyncio.CancelledError


class BlamesTheMachine(Steady):
    def misbehave(self) -> np.ndarray:
        raise SimulationError("SUMO failed, I swear")


class FailsToClose(Steady):
    def close(self) -> None:
        if multiprocessing.parent_process():  # not where it is only described
            raise RuntimeError("it is stuck")


class ExitsInClose(Steady):
    def close(self) -> None:
        if multiprocessing.parent_process():
            sys.exit(3)


class Noted(Steady):
    """Adds a byte to a file in each attempt at an episode."""

    def __init__(self, file: str, after: int = 30) -> None:
        super().__init__(after)
        self.file = file

    def reset(self, mission: Mission, seed: int) -> None:
        super().reset(mission, seed)
        with open(self.file, "ab") as file:
            file.write(b".")


class AnswersNan(Steady):
    def misbehave(self) -> np.ndarray:
        return np.array([np.nan, 0.0])


class AnswersWrongShape(Steady):
    def misbehave(self) -> np.ndarray:
        return np.zeros(7)


class AnswersNothing(Steady):
    def misbehave(self) -> np.ndarray:
        return None  # type: ignore[return-value]


class Hangs(Steady):
    def misbehave(self) -> np.ndarray:
        while True:
            try:
                time.sleep(60)
            except Exception:
                continue


class HangsOutsidePython(Steady):
    """Never returns to the interpreter, so that no signal handler of Python's runs."""

    def misbehave(self) -> np.ndarray:
        signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGALRM])
        ctypes.PyDLL(None).sleep(600)
        return np.zeros(2)


class FailsInWarmUp(Steady):
    def warm_up(self) -> None:
        raise ValueError("no such kernel")


class FailsInReset(Steady):
    def reset(self, mission: Mission, seed: int) -> None:
        raise ValueError("no such mission")


class FailsOnSeedOne(Steady):
    """Fails in one episode only."""

    def misbehave(self) -> np.ndarray:
        if self.seed == 1:
            raise RuntimeError("I do not like this seed")
        return np.array([6.0, 0.0])


class DiesOnce(Steady):
    """Its process dies in its first attempt, as by a segmentation fault."""

    def __init__(self, marker: str = "", after: int = 5) -> None:
        super().__init__(after)
        self.marker = marker

    def misbehave(self) -> np.ndarray:
        if not os.path.exists(self.marker):
            with open(self.marker, "w"):
                pass
            signal.raise_signal(signal.SIGKILL)  # a confined process may not call kill(2), not for itself either
        return np.array([6.0, 0.0])


def kill_the_actor(number: int = signal.SIGKILL) -> None:
    """Sends a signal to the Ray actor that started the server from which this process was forked."""
    server = Path(f"/proc/{os.getppid()}/stat").read_text()
    os.kill(int(server.rpartition(")")[2].split()[1]), number)


class DiesAlways(Steady):
    def misbehave(self) -> np.ndarray:
        signal.raise_signal(signal.SIGKILL)
        return np.zeros(2)


class NeedsTooMuch(Steady):
    spec = AgentSpec(name="greedy", track="sensors", sensors=("objects",))


class FailsWhenMade(Steady):
    def __init__(self) -> None:
        raise OSError("no weights here")


class Plain:
    """Has what every agent needs, no base, and none of the optional methods."""

    spec = AgentSpec(name="plain", sensors=("speedometer",), control="lane_command")

    def reset(self, mission: Mission, seed: int) -> None:
        self.seed = seed

    def act(self, observation: Observation) -> np.ndarray:
        return np.array([6.0, 0.0])


class Slotted:
    """Has no room for methods that it lacks."""

    __slots__ = ("seed",)
    spec, reset, act = Plain.spec, Plain.reset, Plain.act


class WithDict(Plain):
    spec: ClassVar[dict[str, str]] = {"name": "with-dict"}  # type: ignore[assignment]


class NeverCloses(Plain):
    """Fails to close also where it is only described."""

    def close(self) -> None:
        raise RuntimeError("nothing to close")


class Explains(Plain):
    def explain(self) -> dict[str, object]:
        return {"trajectory": np.zeros((3, 2)), "leader": float("inf"), "seed": self.seed}
