"""WorldOrder: what the server asks of a world's process."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from dohyo.evaluation.agent import AgentSpec
from dohyo.sumo_networks.scenario import Config, Scenario

Undriven = Literal["autopilot", "stand", "out"]
Late = Literal["repeat", "leave"]


class WorldOrder(Config):
    """One world to simulate.

    Attributes:
        name: File name of the record, without suffix.
        scenario: Scenario of the world.
        undriven: What an ego without a driver does: the autopilot drives it, it stands, or it leaves the road.
        directory: Folder for the record; None: there is none.
    """

    name: str
    scenario: Scenario
    undriven: Undriven = "autopilot"
    directory: Path | None = None


class Drivers(Config):
    """A change of drivers.

    Attributes:
        revision: Number of the change, from 1; the next observations have it.
        specs: New driver of each ego that changes; None: nobody drives it now.
    """

    revision: int
    specs: dict[str, AgentSpec | None]
