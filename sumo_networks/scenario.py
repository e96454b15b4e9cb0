"""Scenario: everything needed to replay an episode, seed included."""

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
    """Vehicles that follow each other along one path during the whole episode, in addition to the population.

    The vehicles enter at the beginning of the source, even within sight of an ego, and wait outside while there is
    no room. Exactly one of `vehicles_per_hour`, `gap_s` and `spacing_m` sets how closely they follow each other.

    Attributes:
        source: SUMO id of the edge on which the vehicles enter, or of a lane if all must enter on the same lane.
        target: SUMO id of the edge at which they leave; they take the fastest path.
        type: Vehicle type; None: cars, vans, trucks and buses, mixed as in the population.
        vehicles_per_hour: Mean number of vehicles per hour, each at a random time.
        gap_s: Shortest and longest time between two vehicles, s; the times are uniformly distributed.
        spacing_m: Shortest and longest distance between two fronts at the speed limit of the source, m; uniform too.
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
    """Traffic around the egos: a population of constant size, and flows.

    Attributes:
        vehicles: Number of cars, vans, trucks and buses.
        bicycles: Number of bicycles.
        pedestrians: Number of people on foot.
        warm_up_s: Simulated time before the egos start.
        jaywalkers: Share of the pedestrians that cross roads away from crossings, see `traffic.jaywalkers`.
        impatience: SUMO's driver impatience in [0, 1]: 1 lets a driver who must give way enter any gap that others can
            keep open by braking, 0 none. SUMO's default is 0.
        flows: Flows in addition to the population.
    """

    vehicles: Annotated[int, Field(ge=0, le=20_000)] = 0
    bicycles: Annotated[int, Field(ge=0, le=20_000)] = 0
    pedestrians: Annotated[int, Field(ge=0, le=20_000)] = 0
    warm_up_s: Annotated[float, Field(ge=0, le=3600)] = 30.0
    # Fields that most scenarios do not use are left out of the document, so that hashes stay the same.
    jaywalkers: Annotated[float, Field(ge=0, le=1, exclude_if=lambda share: not share)] = 0.0
    impatience: Annotated[float, Field(ge=0, le=1, exclude_if=lambda share: not share)] = 0.0
    flows: Annotated[tuple[TrafficFlow, ...], Field(max_length=100, exclude_if=lambda flows: not flows)] = ()

    @property
    def jaywalker_count(self) -> int:
        """Number of jaywalkers among the pedestrians."""
        return round(self.jaywalkers * self.pedestrians)


class Obstacle(Config):
    """A static box on the road (barrier, skip, fallen tree); SUMO's own traffic does not react to it.

    Attributes:
        x_m: x of the centre, m, network frame.
        y_m: y of the centre, m, network frame.
        heading_rad: Direction of the long side, rad.
        length_m: Extent along the heading, m.
        width_m: Extent across the heading, m.
    """

    x_m: float
    y_m: float
    heading_rad: float = 0.0
    length_m: Annotated[float, Field(gt=0)] = 2.0
    width_m: Annotated[float, Field(gt=0)] = 2.0


class Scenario(Config):
    """Everything needed to replay an episode.

    Attributes:
        name: Unique within its benchmark.
        cell: Name of the benchmark's part that the scenario belongs to.
        network: Name in the catalog, or path of a .net.xml[.gz] file.
        missions: One mission per ego.
        traffic: Population and flows around the egos.
        conditions: Name of the road, light and air conditions, see `dohyo.sumo_networks.conditions`.
        obstacles: Static boxes on the roads.
        events: Scripted events around the egos.
        time_limit_s: Simulated time after which the episode fails, s; None: derived from the route's length.
        stop_on_collision: Whether an ego's episode ends at its first collision (NoCrash); otherwise the ego drives on.
        seed: Seed of everything random in the world.
        duration_s: Simulated time after which the episode ends without failure, s; None: it ends at the goal.
        reference_m: Distance that a reference driver covered in `duration_s`, m, for scores that compare with it.
        log: Content hash of the traffic log that all actors except the egos replay; None: SUMO simulates them.
    """

    name: Name = "scenario"
    cell: Name = "all"
    network: str
    missions: Annotated[tuple[Mission, ...], Field(min_length=1)]
    traffic: Traffic = Traffic()
    conditions: str = "clear"
    obstacles: tuple[Obstacle, ...] = ()
    # An empty list is left out of the document, so that scenarios without events keep their hashes.
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
        """Hex sha256 of everything that determines the episode."""
        return content_hash(self.model_dump(mode="json"))


def content_hash(document: object) -> str:
    """Hex sha256 of a JSON document in canonical form (sorted keys, no spaces)."""
    text = json.dumps(document, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()
