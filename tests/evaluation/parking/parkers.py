"""Agents that park, or fail to."""

from __future__ import annotations

import math
import os
import signal
import time
from pathlib import Path
from typing import Any

import numpy as np

from dohyo.evaluation.parking.agent import ParkingSpec
from dohyo.sumo_networks.errors import SimulationError
from dohyo.sumo_networks.parking import kart
from dohyo.sumo_networks.parking.rows import LotView


class Greedy:
    """Drives to a point before its spot and then in; blind for everything in the way."""

    def __init__(self, gain: float = 2.0) -> None:
        self.spec, self.gain = ParkingSpec(name="greedy"), gain

    def reset(self, seed: int) -> None:
        """Nothing to prepare."""

    def act(self, observation: np.ndarray) -> np.ndarray:
        """See the class."""
        ahead, left = 5 * observation[14], 5 * observation[15]
        dx, dy = 80 * observation[9], 80 * observation[10]
        if math.hypot(dx, dy) > 5.0:
            error = math.remainder(math.atan2(dy - 4.5, dx) - math.pi * observation[0], math.tau)
            target_mps = 2.0
        else:
            error = -math.atan2(observation[13], observation[12]) - math.atan(1.2 * left)
            target_mps = 1.0
        if ahead > -0.25:
            return np.array([0.0, 0.0, 1.0])
        speed = kart.MAX_SPEED_MPS * math.hypot(observation[4], observation[5])
        return np.array([np.clip(target_mps - speed + 0.06, 0, 1), np.clip(self.gain * error, -1, 1), -1.0])


class Halting(Greedy):
    """Goes no further than before a lot that the environment names."""

    def reset(self, seed: int) -> None:
        """See the class."""
        if os.environ.get("HALTS_AT") == str(seed):
            time.sleep(50.0)


class Sleeper(Greedy):
    """Never decides a second time."""

    decided = False

    def act(self, observation: np.ndarray) -> np.ndarray:
        """See the class."""
        if self.decided:
            time.sleep(60.0)
        self.decided = True
        return super().act(observation)


class Fatal(Greedy):
    """Takes its process with it in one lot, at the second decision."""

    def __init__(self, fault: str = "", lot: int = -1, marker: str = "") -> None:
        super().__init__()
        self.fault, self.lot, self.marker = fault, lot, marker

    def reset(self, seed: int) -> None:
        """See the class."""
        self.fatal, self.decided = seed == self.lot, False

    def act(self, observation: np.ndarray) -> np.ndarray:
        """See the class."""
        if self.fatal and self.decided:
            self.end()
        self.decided = True
        return super().act(observation)

    def end(self) -> None:
        """Sleeps, so that nothing can wake it or so that a signal can, or ends its process, each time or once."""
        if self.fault == "deaf":
            signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGALRM])
        if self.fault in ("late", "deaf"):
            time.sleep(60.0)
        if self.fault == "exit" or not Path(self.marker).exists():
            if self.marker:
                Path(self.marker).touch()
            os._exit(3)


class ExitsInClose(Greedy):
    """Ends its process where it is closed in a process that drives."""

    def reset(self, seed: int) -> None:
        """See the class."""
        self.drove = True

    def close(self) -> None:
        """See the class."""
        if hasattr(self, "drove"):
            os._exit(3)


class Seer(Greedy):
    """A privileged agent that checks what it is shown."""

    def __init__(self) -> None:
        super().__init__()
        self.spec = ParkingSpec(name="seer", track="privileged")

    def look(self, lot: LotView, number: int) -> None:
        """See `ParkingAgent`."""
        self.seen = lot.karts[number, [kart.X, kart.Y]]

    def act(self, observation: np.ndarray) -> np.ndarray:
        """See the class."""
        assert np.allclose(80 * observation[1:3], self.seen, atol=1e-4)
        return super().act(observation)


class Broken(Greedy):
    """Fails after some decisions."""

    def __init__(self, answer: Any = "raise", after: int = 3) -> None:
        super().__init__()
        self.answer, self.after = answer, after

    def act(self, observation: np.ndarray) -> np.ndarray:
        """See the class."""
        self.after -= 1
        if self.after >= 0:
            return super().act(observation)
        if isinstance(self.answer, str):
            raise {
                "raise": ZeroDivisionError("no way"),
                "exit": SystemExit(0),
                "no machine": SimulationError("not my fault"),
            }[self.answer]
        return np.asarray(self.answer)
