"""WorldOrder: what the server asks of a world's process."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from dohyo.evaluation.agent import AgentSpec
from dohyo.service.worlds.live.clock import Pace
from dohyo.sumo_networks.scenario import Config, Scenario

Undriven = Literal["autopilot", "stand", "out"]
Late = Literal["repeat", "leave"]


class WorldRules(Config):
    """What the server does with a world.

    Attributes:
        deadline_s: Time for one decision, s.
        late: What happens to a driver that is late: its last decision is repeated, or it loses its place.
        pace: lockstep: each tick waits for all decisions; realtime: it begins when its time has come.
        speed: Simulated seconds per second of the wall clock, in real time.
    """

    deadline_s: float
    late: Late
    pace: Pace
    speed: float


class WorldOrder(Config):
    """One world to simulate.

    Attributes:
        name: File name of the record, without suffix.
        scenario: Scenario of the world.
        undriven: What an ego without a driver does: the autopilot drives it, it stands, or it leaves the road.
        directory: Folder for the record; None: there is none.
        stays: Whether the world stays when all egos have ended their drives, to be reset.
        reward: Name of the reward function of its outcomes; None: it has none.
    """

    name: str
    scenario: Scenario
    undriven: Undriven = "autopilot"
    directory: Path | None = None
    stays: bool = False
    reward: str | None = None


class Drivers(Config):
    """A change of drivers.

    Attributes:
        revision: Number of the change, from 1; the next observations have it.
        specs: New driver of each ego that changes; None: nobody drives it now.
        coupled: Whether a simulator is coupled to the world, which sees all actors.
    """

    revision: int
    specs: dict[str, AgentSpec | None]
    coupled: bool = False


class Reset(Config):
    """A new beginning of a world, with the same drivers.

    Attributes:
        revision: Number of the change, as in `Drivers`.
        seed: Seed of the scenario.
    """

    revision: int
    seed: int
