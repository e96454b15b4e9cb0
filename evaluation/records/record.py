"""EpisodeRecord: the facts of one episode, from which every score can be recomputed.

A record is two files: `NAME.json` (facts) and `NAME.parquet` (trajectories). The JSON is written last and atomically,
so a record either exists whole or not at all. Its hash covers the facts and the trajectories, and nothing that depends
on the wall clock or the machine's load.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from dohyo.evaluation.records.specifications import InfractionKind, Status, Unit
from dohyo.sumo_networks.scenario import Config, Scenario


class Infraction(Config):
    """One thing that went wrong, at one moment.

    Attributes:
        kind: What.
        time_s: Simulated time since the ego's start.
        x_m: Where the ego's centre was, network frame.
        y_m: Where the ego's centre was, network frame.
        route_m: Progress along the route then.
        actor: SUMO id of the other, of the traffic light or of the lane; None where there is none.
        magnitude: How much, in the kind's unit: closing speed of a collision, m/s; ego's speed over a stop line, m/s;
            distance driven outside the lanes, from the route or ahead of an emergency vehicle, m; ego's speed in
            percent of the traffic's; time stood or elapsed, s.
        at_fault: Whether the ego caused it (nuPlan's rules); None where the question does not arise.
    """

    kind: InfractionKind
    time_s: float
    x_m: float
    y_m: float
    route_m: float
    actor: str | None = None
    magnitude: float = 0.0
    at_fault: bool | None = None

    @property
    def unit(self) -> Unit:
        """Unit of the magnitude."""
        return self.kind.specification.unit


class AgentInfo(Config):
    """Who drove: enough to drive again.

    Attributes:
        name: For people.
        entry: "module:Class" that makes it.
        source_sha256: Of the files it is made of, so that a changed agent is not mistaken for the old one.
        track: Which sensors it may use.
        sensors: What it sees.
        control: How it acts.
        settings: What it was made with.
    """

    name: str
    entry: str
    source_sha256: str = ""
    track: Literal["sensors", "map", "privileged"]
    sensors: tuple[str, ...]
    control: str
    settings: dict[str, Any] = Field(default_factory=dict)


class EgoRecord(Config):
    """What one ego did.

    Attributes:
        name: The mission's name.
        agent: Who drove.
        status: How it ended.
        failure: One line for a human where the agent or the simulation failed, else None.
        duration_s: Simulated time from start to end.
        route_length_m: Length of the planned route.
        progress_m: Furthest progress along the route.
        driven_m: Distance driven.
        outside_lanes_m: Distance driven with the centre outside the lanes.
        contacts: Number of distinct actors ever touched, at fault or not.
        infractions: In the order of time.
    """

    name: str
    agent: AgentInfo
    status: Status
    failure: str | None = None
    duration_s: Annotated[float, Field(ge=0)]
    route_length_m: Annotated[float, Field(gt=0)]
    progress_m: Annotated[float, Field(ge=0)]
    driven_m: Annotated[float, Field(ge=0)]
    outside_lanes_m: Annotated[float, Field(ge=0)] = 0.0
    contacts: Annotated[int, Field(ge=0)] = 0
    infractions: tuple[Infraction, ...] = ()


class Versions(Config):
    """What produced the record; part of its hash, since any of them may change the numbers."""

    dohyo: str
    sumo: str
    network_sha256: str
    record: Literal[3] = 3


class Timing(Config):
    """Wall-clock facts; never part of the hash.

    Attributes:
        created: ISO 8601, UTC.
        wall_s: Time of the whole episode.
        ticks_per_s: Simulation ticks per wall second.
        decision_ms: Milliseconds per decision by ego: p50, p95, p99.
        realtime: Whether the simulation went on by the wall clock, without waiting for late decisions. Such an episode
            cannot be driven again, and no ranking takes it.
        missed: Ticks that went by with the last decision because none had come in time; only if `realtime`.
    """

    created: str
    wall_s: float
    ticks_per_s: float
    decision_ms: dict[str, tuple[float, float, float]] = Field(default_factory=dict)
    realtime: bool = False
    missed: int = 0


class EpisodeRecord(Config):
    """The facts of one episode.

    Attributes:
        scenario: Everything needed to replay it.
        benchmark: Name and content hash of the benchmark it belongs to, or None.
        egos: One per mission, in the scenario's order.
        ticks: Number of ticks simulated.
        versions: What produced it.
        trajectory_sha256: Digest of the trajectories' values (not of the Parquet file, whose bytes may vary).
        record_hash: Digest of all of the above.
        timing: Wall-clock facts, outside the hash.
    """

    scenario: Scenario
    benchmark: tuple[str, str] | None = None
    egos: tuple[EgoRecord, ...]
    ticks: int
    versions: Versions
    trajectory_sha256: str
    record_hash: str = ""
    timing: Timing | None = None

    @property
    def lost(self) -> bool:
        """Whether the infrastructure failed in it: such an episode is in no mean, whatever its other egos did."""
        return any(ego.status.infrastructure_fault for ego in self.egos)
