"""GuardedAgent: calls an agent under deadlines and turns each of its failures into a status."""

from __future__ import annotations

import re
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np

from dohyo.evaluation.agent import Agent, Observation
from dohyo.evaluation.blame import RAISED, is_blameless
from dohyo.evaluation.episode.deadline import deadline
from dohyo.evaluation.records.specifications import Status
from dohyo.sumo_networks.ego.control import InvalidActionError
from dohyo.sumo_networks.errors import AgentError, AgentTimeoutError
from dohyo.sumo_networks.scenario import Mission

ACT_DEADLINE_S = 10.0
RESET_DEADLINE_S = 60.0
WARM_UP_DEADLINE_S = 600.0
"""A slow machine with an empty cache compiles for minutes."""
LONGEST_FAILURE = 500

T = TypeVar("T")


class AgentFailedError(AgentError):
    """Failure of an agent, which ends the episode of its ego.

    Attributes:
        status: Status with which the episode ends.
    """

    def __init__(self, status: Status, message: str) -> None:
        super().__init__(message)
        self.status = status


class GuardedAgent:
    """Calls an agent under deadlines; a failure raises AgentFailedError with its status.

    Attributes:
        agent: Agent that is called.
        latencies_s: Wall-clock time of every decision, s.
    """

    def __init__(self, agent: Agent, act_deadline_s: float, watch: Callable[[float], None]) -> None:
        """Stores the agent without calling it.

        Args:
            agent: Agent to call.
            act_deadline_s: Wall-clock time allowed for one decision, s.
            watch: Function called with the deadline in seconds before every call of the agent, and with 0 after it.
        """
        self.agent, self.latencies_s = agent, list[float]()
        self._act_deadline_s, self._watch = act_deadline_s, watch

    def reset(self, mission: Mission, seed: int) -> None:
        """Warms the agent up and prepares it for an episode.

        Raises:
            AgentFailedError: The agent raised, wanted to end the process, or took too long.
            SimulationError: The machine failed, not the agent.
        """
        if hasattr(self.agent, "warm_up"):  # optional
            self._call(self.agent.warm_up, WARM_UP_DEADLINE_S, Status.AGENT_SETUP)
        self._call(lambda: self.agent.reset(mission, seed), RESET_DEADLINE_S, Status.AGENT_SETUP)

    def act(self, observation: Observation, check: Callable[[object], None]) -> np.ndarray:
        """Asks the agent for one decision.

        Args:
            observation: Readings of the ego's sensors.
            check: Function that raises InvalidActionError for an action that cannot be driven.

        Raises:
            AgentFailedError: The agent raised, wanted to end the process or took too long, or the action is invalid.
            SimulationError: The machine failed, not the agent.
        """
        began = time.perf_counter()
        action = self._call(lambda: self.agent.act(observation), self._act_deadline_s, Status.AGENT_RAISED)
        self.latencies_s.append(time.perf_counter() - began)
        try:
            check(action)
        except InvalidActionError as error:
            raise AgentFailedError(Status.AGENT_ACTION, str(error)) from error
        return action

    def decision_ms(self) -> tuple[float, float, float]:
        """Milliseconds per decision: p50, p95, p99; zeros if there was no decision."""
        if not self.latencies_s:
            return 0.0, 0.0, 0.0
        p50, p95, p99 = np.percentile(np.array(self.latencies_s) * 1000.0, [50, 95, 99]).round(3)
        return float(p50), float(p95), float(p99)

    def _call(self, call: Callable[[], T], seconds: float, failed: Status) -> T:
        self._watch(seconds)
        try:
            with deadline(seconds, f"agent '{self.agent.spec.name}'"):
                return call()
        except AgentTimeoutError as error:
            raise AgentFailedError(Status.AGENT_DEADLINE, str(error)) from error
        except InvalidActionError as error:
            raise AgentFailedError(Status.AGENT_ACTION, str(error)) from error
        except AgentError as error:  # its message is already written for people
            raise AgentFailedError(failed, str(error)[:LONGEST_FAILURE]) from error
        except RAISED as error:  # the evaluation must go on
            if is_blameless(error, self.agent):
                raise
            raise AgentFailedError(failed, describe(error)) from error
        finally:
            self._watch(0.0)


def describe(error: BaseException) -> str:
    """Type, message and place of an error, without memory addresses, which differ from run to run."""
    frames = traceback.extract_tb(error.__traceback__)
    where = f" ({Path(frames[-1].filename).name}:{frames[-1].lineno})" if frames else ""
    text = f"{type(error).__name__}: {error}{where}"
    return re.sub(r"0x[0-9a-f]+", "0x", text)[:LONGEST_FAILURE]
