"""EpisodeRecord: the facts of one episode, from which every score can be recomputed.

A record is two files: `NAME.json` (facts) and `NAME.parquet` (trajectories). The JSON is written last and atomically,
so a record either exists whole or not at all. Its hash covers the facts and the trajectories, and nothing that depends
on the wall clock or the machine's load.
"""

from __future__ import annotations

import re
from typing import Annotated, Any, Final, Literal

from pydantic import AfterValidator, Field

from dohyo.evaluation.records.specifications import InfractionKind, Status, Unit
from dohyo.sumo_networks.scenario import Config, Scenario

_CONTROL: Final = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029]")

Line = Annotated[str, AfterValidator(lambda text: _CONTROL.sub(" ", text))]
"""Text of a stranger that terminals and pages show: control characters, which a terminal obeys, become spaces."""


class Infraction(Config):
    """One infraction of an ego, at one moment.

    Attributes:
        kind: Kind of infraction.
        time_s: Simulated time since the ego's start, s.
        x_m: x of the ego's centre, m, network frame.
        y_m: y of the ego's centre, m, network frame.
        route_m: Progress of the ego along its route, m.
        actor: SUMO id of the other actor, of the traffic light or of the lane; None if none is involved.
        magnitude: Size of the infraction, in the unit of its kind. Collision: closing speed, m/s. Stop line: speed of
            the ego, m/s. Lanes, route and emergency vehicle: distance outside, from or ahead of it, m. Minimum speed:
            speed of the ego in percent of the traffic's. Others: time stood or elapsed, s.
        at_fault: Whether the ego caused the collision (nuPlan's rules); None for other kinds.
    """

    kind: InfractionKind
    time_s: float
    x_m: float
    y_m: float
    route_m: float
    actor: Line | None = None
    magnitude: float = 0.0
    at_fault: bool | None = None

    @property
    def unit(self) -> Unit:
        """Unit of the magnitude."""
        return self.kind.specification.unit


Kind = Literal["builtin", "onnx", "remote", "local"]


class AgentInfo(Config):
    """Description of an agent, sufficient to drive its episodes again.

    Attributes:
        name: Name of the agent, for people.
        kind: Origin of the agent: registered by an installed package, an ONNX policy of a service, remote (it drove
            through policy workers), or local (an entry of the user's own). A fact for readers: who builds an agent from
            a record must not rely on it.
        entry: "module:Class" of the agent.
        source_sha256: Hash of the source files of the agent, so that a changed agent is not mistaken for the old one.
        files_sha256: Hash of the files that the agent reads, such as weights; "" if it reads none.
        track: Track, which limits the sensors that the agent may use.
        sensors: Names of the sensors that the agent reads.
        control: Name of the control interface of the agent.
        settings: Keyword arguments that the agent was constructed with.
    """

    name: Line
    kind: Kind = "local"
    entry: Line
    source_sha256: str = ""
    files_sha256: str = ""
    track: Literal["sensors", "map", "privileged"]
    sensors: tuple[str, ...]
    control: str
    settings: dict[str, Any] = Field(default_factory=dict)


class EgoRecord(Config):
    """The drive of one ego.

    Attributes:
        name: Name of the mission.
        agent: Agent that drove.
        status: Status with which the drive ended.
        failure: One line for people if the agent or the simulation failed, else None.
        duration_s: Simulated time from start to end, s.
        route_length_m: Length of the planned route, m.
        progress_m: Largest progress along the route, m.
        driven_m: Distance driven, m.
        outside_lanes_m: Distance driven with the centre outside the lanes, m.
        contacts: Number of distinct actors that the ego ever touched, at fault or not.
        infractions: Infractions in the order of time.
    """

    name: str
    agent: AgentInfo
    status: Status
    failure: Line | None = None
    duration_s: Annotated[float, Field(ge=0)]
    route_length_m: Annotated[float, Field(gt=0)]
    progress_m: Annotated[float, Field(ge=0)]
    driven_m: Annotated[float, Field(ge=0)]
    outside_lanes_m: Annotated[float, Field(ge=0)] = 0.0
    contacts: Annotated[int, Field(ge=0)] = 0
    infractions: tuple[Infraction, ...] = ()


class Versions(Config):
    """Versions of the software and network behind a record; part of its hash, since each may change the numbers."""

    dohyo: str
    sumo: str
    network_sha256: str
    record: Literal[4] = 4


class Timing(Config):
    """Wall-clock facts; never part of the hash.

    Attributes:
        created: Date and time at which the record was made, ISO 8601, UTC.
        wall_s: Wall-clock time of the whole episode, s.
        ticks_per_s: Simulation ticks per second of wall-clock time.
        decision_ms: Milliseconds per decision, by the name of the ego: p50, p95, p99.
        realtime: Whether the simulation followed the wall clock, without waiting for late decisions. Such an episode
            cannot be reproduced, and no ranking includes it.
        missed: Number of ticks that used the previous decision since the next one was late; only if `realtime`.
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
        scenario: Scenario, which has everything needed to drive the episode again.
        benchmark: Name and content hash of the benchmark of the episode, or None.
        egos: Drives, one per mission, in the order of the scenario.
        ticks: Number of ticks simulated.
        versions: Versions that produced the record.
        trajectory_sha256: Digest of the trajectories' values (not of the Parquet file, whose bytes may vary).
        record_hash: Digest of all of the above.
        timing: Wall-clock facts, which are not in the hash.
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
    def fault(self) -> Status | None:
        """The infrastructure fault for which the episode is lost, with all of its egos; None: it is not lost."""
        return next((ego.status for ego in self.egos if ego.status.infrastructure_fault), None)

    @property
    def lost(self) -> bool:
        """Whether the infrastructure failed in the episode: then none of its egos enters a mean."""
        return self.fault is not None
