"""Kinds of agents' faults, kept beside staged records that have the reason alone: lots, mornings, days of forecasts."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from dohyo.evaluation.records.specifications import Status
from dohyo.sumo_networks.ego.control import InvalidActionError
from dohyo.sumo_networks.errors import AgentSetupError, AgentTimeoutError
from dohyo.sumo_networks.files import write_atomically

SUFFIX: Final = ".fault"
_KINDS: Final = (
    (AgentTimeoutError, Status.AGENT_DEADLINE),
    (InvalidActionError, Status.AGENT_ACTION),
    (AgentSetupError, Status.AGENT_SETUP),
)


def fault_of(error: BaseException, otherwise: Status = Status.AGENT_RAISED) -> Status:
    """Status that a drive on roads would have after an agent's error.

    Args:
        error: What the call of the agent raised.
        otherwise: Status after an error that is neither of time nor of an action.
    """
    return next((status for kind, status in _KINDS if isinstance(error, kind)), otherwise)


class FaultWatch:
    """Notes how agents fail whose records do not say it.

    Attributes:
        noted: Status by the number of the agent.
    """

    def __init__(self) -> None:
        """Begins without a fault."""
        self.noted: dict[int, Status] = {}

    @contextmanager
    def watching(self, agent: int = 0, otherwise: Status = Status.AGENT_RAISED) -> Iterator[None]:
        """Notes what its block, a call of an agent, raises."""
        try:
            yield
        except BaseException as error:
            self.noted[agent] = fault_of(error, otherwise)
            raise

    def of(self, agent: int = 0) -> Status:
        """Status of an agent that has failed: where its calls raised nothing, what they returned was invalid."""
        return self.noted.get(agent, Status.AGENT_ACTION)


def keep_fault(directory: Path, stem: str, status: Status) -> None:
    """Writes the kind of a fault beside the record that will be staged there.

    Raises:
        OSError: The file cannot be written.
    """
    directory.mkdir(parents=True, exist_ok=True)
    write_atomically(directory / f"{stem}{SUFFIX}", status.value.encode())


def kept_fault(staged: Path) -> Status:
    """Kind of the fault of a staged record whose agent has failed; "agent raised" where none is known.

    Args:
        staged: Path of the record's JSON file.
    """
    with suppress(OSError, ValueError):
        return Status(staged.with_suffix(SUFFIX).read_text(encoding="utf-8"))
    return Status.AGENT_RAISED
