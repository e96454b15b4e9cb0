"""Bodies of the routes of worlds: pydantic for orders, msgspec where observations are passed on."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec
from msgspec import UNSET, Meta, UnsetType
from pydantic import BaseModel, ConfigDict, Field, StrictBool, StrictInt, model_validator

from dohyo.service.simulating.actors import ActorChange, ShownActor
from dohyo.service.simulating.order import Late, Undriven
from dohyo.service.wire.bodies import Observations, Reply, Step, Tick, ToldMission
from dohyo.service.worlds.live.clock import Pace

MOST_EGOS = 64
Text = Annotated[str, Field(min_length=1, max_length=100)]
Speed = Annotated[float, Field(ge=0.01, le=100)]
Documents = Annotated[list[dict[str, Any]], Field(fail_fast=True)]  # an error for each item of thousands takes a second


class WorldRequest(BaseModel):
    """A world to start: a scenario of a benchmark, one of your own, or a network with what happens on it.

    Attributes:
        benchmark: Name of a benchmark of drives.
        mission: Name of a scenario of the benchmark; without it, the first one.
        scenario: A scenario of your own, as records have it, with its seed.
        network: Name of a network.
        missions: On the network: missions of the egos, as scenarios have them, or how many are drawn.
        traffic: On the network: vehicles, bicycles, pedestrians and flows, as scenarios have them; by default none.
        conditions: On the network: name of the weather.
        events: On the network: scripted events around the egos, as scenarios have them.
        obstacles: On the network: static boxes, as scenarios have them.
        seed: Seed of the benchmark's scenario, or of what is drawn and happens on the network.
        undriven: What an ego without a driver does: the autopilot drives it, it stands, or it leaves the road.
        deadline_s: Time for one decision, s; by default as for episodes.
        late: What happens to a driver that is late: its last decision is repeated, or it loses its place.
        record: Whether the world is recorded; the record is not ranked.
        pace: lockstep: each tick waits for all decisions; realtime: it begins when its time has come.
        speed: Simulated seconds per second of the wall clock, in real time.
        stays: Whether the world stays when all egos have ended their drives, until it is reset or ended.
        reward: Name of a reward function, for training; replies to steps then have outcomes.
    """

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={
            "examples": [
                {"network": "ingolstadt", "missions": 2, "traffic": {"vehicles": 30}, "seed": 7},
                {"benchmark": "fleet", "mission": "ingolstadt", "seed": 0, "record": True},
            ]
        },
    )

    benchmark: Text | None = None
    mission: Text | None = None
    scenario: dict[str, Any] | None = None
    network: Text | None = None
    missions: Annotated[StrictInt, Field(ge=1, le=MOST_EGOS)] | Documents = 1
    traffic: dict[str, Any] = {}
    conditions: Text = "clear"
    events: Documents = []
    obstacles: Documents = []
    seed: Annotated[StrictInt, Field(ge=0, lt=2**31)] = 0
    undriven: Undriven = "autopilot"
    deadline_s: Annotated[float | None, Field(ge=0.1, le=600)] = None
    late: Late = "repeat"
    record: StrictBool = False
    pace: Pace = "lockstep"
    speed: Speed = 1.0
    stays: StrictBool = False
    reward: Literal["roach", "progress"] | None = None

    @model_validator(mode="after")
    def _one_scenario(self) -> WorldRequest:
        given = [name for name in ("benchmark", "scenario", "network") if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(f"expected one of benchmark, scenario and network, got {' and '.join(given) or 'none'}")
        alone = {"missions", "traffic", "conditions", "events", "obstacles"} & self.model_fields_set
        if self.network is None and alone:
            raise ValueError(f"expected {', '.join(sorted(alone))} beside a network only")
        return self


class JoinRequest(BaseModel):
    """A worker that joins a world.

    Attributes:
        name: Name of the worker in the world; who joins again by the same name takes the place back.
        egos: Egos that it drives; none: only for a simulator that is coupled.
        coupled: Whether it is a simulator that sees all egos and the traffic, and puts actors of its own.
        invitation: Code of an invitation, for a worker of another owner than the world's.
    """

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={
            "examples": [
                {"name": "alice", "egos": ["west-1"], "sensors": ["route"], "control": "target_speed_steering"}
            ]
        },
    )

    name: Text
    egos: Annotated[list[Text], Field(max_length=MOST_EGOS)] = []
    coupled: StrictBool = False
    invitation: Annotated[str | None, Field(min_length=1, max_length=100)] = None
    track: Literal["sensors", "map", "privileged"] = "map"
    sensors: Annotated[list[Text], Field(min_length=1, max_length=50)] = ["speedometer", "route"]
    control: Text = "target_speed_steering"

    @model_validator(mode="after")
    def _an_ego_or_coupled(self) -> JoinRequest:
        if not self.egos and not self.coupled:
            raise ValueError("expected egos to drive, or coupled: true")
        return self


class WorldInvitationRequest(BaseModel):
    """An invitation of another owner to a world.

    Attributes:
        egos: Egos that the guest may drive; by default all.
        coupled: Whether the guest may couple a simulator, which sees everything and puts actors.
    """

    model_config = ConfigDict(extra="forbid", json_schema_extra={"examples": [{"egos": ["west-2"]}]})

    egos: Annotated[list[Text], Field(min_length=1, max_length=MOST_EGOS)] | None = None
    coupled: StrictBool = False


class StepRequest(BaseModel):
    """How far a paused world goes on.

    Attributes:
        ticks: Number of ticks.
    """

    model_config = ConfigDict(extra="forbid", json_schema_extra={"examples": [{"ticks": 10}]})

    ticks: Annotated[StrictInt, Field(ge=1, le=100_000)] = 1


class ResetRequest(BaseModel):
    """A new beginning of a world.

    Attributes:
        seed: Seed of the scenario; by default the present one.
    """

    model_config = ConfigDict(extra="forbid", json_schema_extra={"examples": [{"seed": 7}]})

    seed: Annotated[StrictInt | None, Field(ge=0, lt=2**31)] = None


class PaceRequest(BaseModel):
    """The pace of a world, from now on.

    Attributes:
        pace: lockstep: each tick waits for all decisions; realtime: it begins when its time has come.
        speed: Simulated seconds per second of the wall clock, in real time.
    """

    model_config = ConfigDict(extra="forbid", json_schema_extra={"examples": [{"pace": "realtime", "speed": 2.0}]})

    pace: Pace = "realtime"
    speed: Speed = 1.0


MOST_POINTS = 100
FARTHEST_M = 1000.0
PlanPoint = tuple[float, float]


class WorldStep(Step, kw_only=True, forbid_unknown_fields=True):
    """Decisions of a place for one tick."""

    resets: Annotated[
        Annotated[int, Meta(ge=0)] | None,
        Meta(
            description="That of the reply with the tick. Where the world has begun anew since, the step is refused; "
            "without it, a step for the same tick of an earlier run is taken."
        ),
    ] = None
    plans: Annotated[
        dict[str, Annotated[list[PlanPoint], Meta(max_length=MOST_POINTS)]] | None,
        Meta(
            description="What egos of the place intend: points ahead in the ego's frame, m, shown to spectators. It "
            "changes nothing else."
        ),
    ] = None
    actors: Annotated[ActorChange | None, Meta(description="Only of a place that is coupled.")] = None


Resets = Annotated[int, Meta(description="How often the world had begun anew at this tick.")]


class EgoOutcome(msgspec.Struct):
    """What the last tick gave an ego, in a world with a reward."""

    reward: Annotated[float, Meta(description="Of that tick.")]
    terminated: Annotated[bool, Meta(description="Whether the reward function, or the goal, ends the episode.")]
    success: Annotated[bool, Meta(description="Whether the ego has reached its goal.")]


class WorldReply(Reply, kw_only=True):
    """Answer to a step, or what a place observes now."""

    outcomes: Annotated[
        dict[str, EgoOutcome] | UnsetType,
        Meta(description="Of each ego of the place that drove in the last tick; only in a world with a reward."),
    ] = UNSET

    resets: Resets = 0
    actors: Annotated[
        list[ShownActor] | UnsetType, Meta(description="All egos and the traffic; only for a place that is coupled.")
    ] = UNSET


class Seated(msgspec.Struct):
    """A place in a world."""

    seat: Annotated[str, Meta(description="Identifier of the place, for the paths of its messages.")]
    token: Annotated[str, Meta(description="Bearer token of all messages of this place.")]
    world: Annotated[str, Meta(description="Identifier of the world.")]
    dt_s: Annotated[float, Meta(description="Simulated time between two decisions, s.")]
    deadline_ms: Annotated[int, Meta(description="Time for one decision, ms.")]
    missions: Annotated[list[ToldMission], Meta(description="One for each ego.")]
    seed: Annotated[int, Meta(description="Seed of the scenario.")]
    tick: Tick
    resets: Resets
    observations: Observations
    actors: Annotated[
        list[ShownActor] | UnsetType, Meta(description="All egos and the traffic; only for a place that is coupled.")
    ] = UNSET
