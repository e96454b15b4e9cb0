"""Tasks that a confined process may run, with the rights of each. A process can run nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Final


class Rights(StrEnum):
    """Rights that a process keeps.

    COMPUTE: memory and its two pipes. FILES: it also reads the installation and the paths it is given, and writes to
    its private folder. PROGRAMS: it also starts programs of the installation.
    """

    COMPUTE = "compute"
    FILES = "files"
    PROGRAMS = "programs"


@dataclass(frozen=True, slots=True)
class ConfinedTask:
    """One task.

    Attributes:
        function: "module:function" that is called in the confined process: with a dictionary of arguments, and with an
            answer of plain JSON; or, if `streams`, with a `frames.Stream`.
        rights: Rights of the process.
        streams: Whether the task answers more than once.
        at_once: Number of processes that `runner.run` lets run such a task at the same time.
    """

    function: str
    rights: Rights
    streams: bool = False
    at_once: int = 2


TASKS: Final[Mapping[str, ConfinedTask]] = {
    "inspect_policy": ConfinedTask("dohyo.service.policies.inspection:inspect_stream", Rights.COMPUTE, streams=True),
    "drive_policy": ConfinedTask("dohyo.service.policies.driving:drive", Rights.COMPUTE, streams=True),
    "describe_agent": ConfinedTask("dohyo.service.submissions.trial:describe_agent", Rights.FILES),
    "import_roads": ConfinedTask("dohyo.service.networks.importing:prepare", Rights.PROGRAMS),
    "redrive": ConfinedTask("dohyo.service.episodes.redrive:drive_again", Rights.PROGRAMS),
    "attempt_to_compute": ConfinedTask("dohyo.service.confinement.probe:attempt", Rights.COMPUTE),
    "attempt_with_files": ConfinedTask("dohyo.service.confinement.probe:attempt", Rights.FILES),
    "attempt_with_programs": ConfinedTask("dohyo.service.confinement.probe:attempt", Rights.PROGRAMS),
}
