"""Every error dohyo raises on purpose: what was expected, what came, and where."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from typing import Any

FEW, NEAREST = 12, 3


class DohyoError(Exception):
    """Root of all errors a user of dohyo may meet; its message is one clear line."""

    def __reduce__(self) -> tuple[Any, ...]:
        """For pickle, which would call a subclass's constructor with the message."""
        return _rebuilt, (type(self), self.args), self.__dict__


def _rebuilt(kind: type[DohyoError], args: tuple[Any, ...]) -> DohyoError:
    error = kind.__new__(kind, *args)
    error.args = args
    return error


class InvalidInputError(DohyoError):
    """Something the caller gave cannot be used: an unknown name, a broken file, an impossible mission."""


class UnknownNameError(InvalidInputError):
    """A name that is in no registry; the message gives the names, or where they are many the nearest ones."""

    def __init__(self, what: str, name: str, known: Iterable[str]) -> None:
        known = sorted(known)
        near = difflib.get_close_matches(name, known, n=1)
        hint = f"; did you mean '{near[0]}'?" if near else ""
        if len(known) <= FEW:
            names = f"there is {', '.join(known) or 'none'}"
        else:
            nearest = difflib.get_close_matches(name, known, n=NEAREST, cutoff=0.0)
            names = f"the nearest of {len(known)} are {', '.join(nearest)}"
        super().__init__(f"no {what} named '{name}'{hint} ({names})")


class AgentError(DohyoError):
    """The agent is at fault: it raised, answered nonsense, or did not answer in time."""


class AgentSetupError(AgentError):
    """The agent could not be built or reset."""


class AgentTimeoutError(AgentError):
    """The agent did not answer before its deadline."""


class SimulationError(DohyoError):
    """The infrastructure is at fault: SUMO failed or lost a vehicle. Never counted against an agent."""
