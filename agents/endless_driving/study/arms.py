"""Arm: one variant of a trainer of endless driving."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

from dohyo.agents.learning.files.settings import read_settings
from dohyo.agents.learning.runs.config import RunConfig


class Reported(NamedTuple):
    """Success that the thesis reports in its unseen town and weather, %; None without a number."""

    empty: float | None = None
    regular: float | None = None
    dense: float | None = None


UNREPORTED: Final = Reported()


@dataclass(frozen=True, slots=True)
class DrivingArm:
    """One variant.

    Attributes:
        isolates: Difference from the whole system.
        config: File of the settings.
        settings: On top of the file's, as "key=value".
        reported: See `Reported`.
    """

    isolates: str
    config: Path
    settings: tuple[str, ...] = ()
    reported: Reported = UNREPORTED

    def training(self, kind: type[RunConfig], seed: int) -> Any:
        """Settings of a training."""
        return read_settings(kind, self.config, (*self.settings, f"seed={seed}"))
