"""Errors of confined tasks."""

from __future__ import annotations

from dohyo.sumo_networks.errors import DohyoError, SimulationError


class ConfinementError(SimulationError):
    """This machine cannot confine a process at the moment. Says nothing about the task's input."""


class TaskError(DohyoError):
    """A task refused its input, or was ended since it passed a limit."""


class TaskTimeoutError(TaskError):
    """A task did not answer in time and was ended."""


class TaskDiskFullError(TaskError):
    """The disk is full; says nothing about the task's input."""


class TaskBrokenError(TaskError):
    """A task failed in a way that it does not know.

    Attributes:
        trace: Last part of its traceback, for the log.
    """

    def __init__(self, detail: str, trace: str = "") -> None:
        super().__init__(detail)
        self.trace = trace
