"""Errors that dohyo raises on purpose; each message says what was expected, what was given, and where."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from typing import Any

FEW, NEAREST = 12, 3


class DohyoError(Exception):
    """Base of all errors that dohyo raises on purpose; the message is one line."""

    def __reduce__(self) -> tuple[Any, ...]:
        """Supports pickle, which would otherwise call a subclass's constructor with the message."""
        return _rebuilt, (type(self), self.args), self.__dict__


def _rebuilt(kind: type[DohyoError], args: tuple[Any, ...]) -> DohyoError:
    error = kind.__new__(kind, *args)
    error.args = args
    return error


class InvalidInputError(DohyoError):
    """The caller's input is not usable: an unknown name, a broken file, an impossible mission."""


class UnknownNameError(InvalidInputError):
    """A name is not in the registry; the message lists the known names, or the nearest ones if there are many."""

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
    """The agent is at fault: it raised an error, returned an invalid answer, or did not answer in time."""


class AgentSetupError(AgentError):
    """The agent could not be built or reset."""


class AgentTimeoutError(AgentError):
    """The agent did not answer before its deadline."""


class SimulationError(DohyoError):
    """The infrastructure is at fault: SUMO failed or lost a vehicle. Never counted against an agent."""
