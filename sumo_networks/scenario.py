"""Scenario: all that is needed to replay an episode, with its seed."""

from __future__ import annotations

import hashlib
import json
from typing import Annotated, Literal

from pydantic import Field, model_validator

from dohyo.sumo_networks.config import OPTIONAL, Config, Mission, Name, Place
from dohyo.sumo_networks.events import Event

__all__ = [
    "Config",
    "Event",
    "Mission",
    "Name",
    "Obstacle",
    "Place",
    "Scenario",
    "Traffic",
    "TrafficFlow",
    "content_hash",
]


class TrafficFlow(Config):
    """Vehicles that follow each other along one way, for as long as the episode lasts; beside the population.

    They enter at the beginning of their source whether an ego sees it or not, and wait outside while there is no room.
    Exactly one of `vehicles_per_hour`, `gap_s` and `spacing_m` says how close they follow.

    Attributes:
        source: Edge they come from; or a lane, on which all then enter.
        target: Edge they go to, on the fastest way.
        type: What they are; None: cars, vans, trucks and buses, mixed as in the population.
        vehicles_per_hour: On average, each at a random time.
        gap_s: Shortest and longest time between two, s; every one between them is as likely.
        spacing_m: The same as a distance between two fronts, m, driven at the speed limit of the source.
    """

    source: str
    target: str
    type: Literal["car", "van", "truck", "bus", "bicycle"] | None = None
    vehicles_per_hour: Annotated[float, Field(gt=0, le=7200)] | None = None
    gap_s: tuple[Annotated[float, Field(ge=0.5)], Annotated[float, Field(le=3600)]] | None = None
    spacing_m: tuple[Annotated[float, Field(ge=5)], Annotated[float, Field(le=10_000)]] | None = None

    @model_validator(mode="after")
    def _gaps_are_one_and_in_order(self) -> TrafficFlow:
        given = [name for name in ("vehicles_per_hour", "gap_s", "spacing_m") if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(
                f"flow from '{self.source}': expected one of vehicles_per_hour, gap_s and spacing_m, "
                f"got {' and '.join(given) or 'none'}"
            )
        for bounds in (self.gap_s, self.spacing_m):
            if bounds is not None and bounds[0] > bounds[1]:
                raise ValueError(f"flow from '{self.source}': expected the shortest gap first, got {bounds}")
        return self


class Traffic(Config):
    """The population around the egos, held constant while they drive, and flows beside it.

    Attributes:
        vehicles: Cars, vans, trucks and buses.
        bicycles: Bicycles.
        pedestrians: People on foot.
        warm_up_s: Simulated time before the egos start.
        jaywalkers: Share of the pedestrians that cross roads away from crossings, see `traffic.jaywalkers`.
        impatience: Of the drivers: how far those that must give way push into gaps that make others brake; 0 never, 1
            always. It is SUMO's, and its default is 0.
        flows: Vehicles that follow each other along one way.
    """

    vehicles: Annotated[int, Field(ge=0, le=20_000)] = 0
    bicycles: Annotated[int, Field(ge=0, le=20_000)] = 0
    pedestrians: Annotated[int, Field(ge=0, le=20_000)] = 0
    warm_up_s: Annotated[float, Field(ge=0, le=3600)] = 30.0
    # What most scenarios have not is left out, so that they keep their hashes.
    jaywalkers: Annotated[float, Field(ge=0, le=1, exclude_if=lambda share: not share)] = 0.0
    impatience: Annotated[float, Field(ge=0, le=1, exclude_if=lambda share: not share)] = 0.0
    flows: Annotated[tuple[TrafficFlow, ...], Field(max_length=100, exclude_if=lambda flows: not flows)] = ()

    @property
    def jaywalker_count(self) -> int:
        """How many of the pedestrians are jaywalkers."""
        return round(self.jaywalkers * self.pedestrians)


class Obstacle(Config):
    """A static box on the road (barrier, skip, fallen tree); SUMO's own traffic does not know it.

    Attributes:
        x_m: Centre, network frame.
        y_m: Centre, network frame.
        heading_rad: Direction of its length.
        length_m: Extent along the heading.
        width_m: Extent across.
    """

    x_m: float
    y_m: float
    heading_rad: float = 0.0
    length_m: Annotated[float, Field(gt=0)] = 2.0
    width_m: Annotated[float, Field(gt=0)] = 2.0


class Scenario(Config):
    """All that is needed to replay an episode.

    Attributes:
        name: Unique within its benchmark.
        cell: The part of the benchmark it belongs to.
        network: Name in the catalog, or path of a .net.xml[.gz].
        missions: One per ego.
        traffic: The population around the egos.
        conditions: Name of the road, light and air, see `dohyo.sumo_networks.conditions`.
        obstacles: Static boxes.
        events: Scripted happenings around the egos.
        time_limit_s: Ends the episode; None: the judge takes it from the route's length.
        stop_on_collision: End an ego's episode at its first collision (NoCrash) instead of driving on.
        seed: Decides everything random in the world.
        duration_s: Ends the episode wherever the ego is then, which is no failure; None: it goes on to the goal.
        reference_m: How far a reference came in that time, for scores that compare with it.
        log: Content hash of the log that all actors but the egos replay; None: SUMO simulates them.
    """

    name: Name = "scenario"
    cell: Name = "all"
    network: str
    missions: Annotated[tuple[Mission, ...], Field(min_length=1)]
    traffic: Traffic = Traffic()
    conditions: str = "clear"
    obstacles: tuple[Obstacle, ...] = ()
    # Left out where there are none, so that scenarios without events keep their hashes.
    events: Annotated[tuple[Event, ...], Field(exclude_if=lambda events: not events)] = ()
    time_limit_s: Annotated[float, Field(gt=0)] | None = None
    stop_on_collision: bool = False
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 0
    duration_s: Annotated[float, Field(gt=0)] | None = OPTIONAL
    reference_m: Annotated[float, Field(ge=0)] | None = OPTIONAL
    log: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")] | None = OPTIONAL

    @model_validator(mode="after")
    def _names_are_unique(self) -> Scenario:
        names = [mission.name for mission in self.missions]
        if len(set(names)) != len(names):
            raise ValueError(f"mission names must be unique, got {names}")
        happenings = [event.name for event in self.events]
        if len(set(happenings)) != len(happenings):
            raise ValueError(f"event names must be unique, got {happenings}")
        for event in self.events:
            if event.ego is not None and event.ego not in names:
                raise ValueError(f"event '{event.name}': no mission named '{event.ego}' (there is {', '.join(names)})")
        return self

    def content_hash(self) -> str:
        """Hex digest of everything that decides the episode."""
        return content_hash(self.model_dump(mode="json"))


def content_hash(document: object) -> str:
    """Hex sha256 of a JSON document in canonical form (sorted keys, no spaces)."""
    text = json.dumps(document, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()
