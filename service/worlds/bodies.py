"""Bodies of the routes of worlds: pydantic for orders, msgspec where observations are passed on."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta
from pydantic import BaseModel, ConfigDict, Field, model_validator

from dohyo.service.wire.bodies import Observations, Tick, ToldMission
from dohyo.service.worlds.order import Late, Undriven

Text = Annotated[str, Field(min_length=1, max_length=100)]


class WorldRequest(BaseModel):
    """A world to start: a scenario of a benchmark, or one of your own.

    Attributes:
        benchmark: Name of a benchmark of drives; without it, `scenario` is needed.
        mission: Name of a scenario of the benchmark; without it, the first one.
        seed: Seed of the benchmark's scenario.
        scenario: A scenario of your own, as records have it: network, missions, traffic, conditions, events, seed.
        undriven: What an ego without a driver does: the autopilot drives it, it stands, or it leaves the road.
        deadline_s: Time for one decision, s; by default as for episodes.
        late: What happens to a driver that is late: its last decision is repeated, or it loses its place.
        record: Whether the world is recorded; the record is not ranked.
    """

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={"examples": [{"benchmark": "fleet", "mission": "ingolstadt", "seed": 0, "record": True}]},
    )

    benchmark: Text | None = None
    mission: Text | None = None
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 0
    scenario: dict[str, Any] | None = None
    undriven: Undriven = "autopilot"
    deadline_s: Annotated[float | None, Field(ge=0.1, le=600)] = None
    late: Late = "repeat"
    record: bool = False

    @model_validator(mode="after")
    def _one_scenario(self) -> WorldRequest:
        if (self.benchmark is None) == (self.scenario is None):
            raise ValueError("expected either benchmark or scenario")
        return self


class JoinRequest(BaseModel):
    """A worker that joins a world.

    Attributes:
        name: Name of the worker in the world; who joins again by the same name takes the place back.
        egos: Egos that it drives.
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
    egos: Annotated[list[Text], Field(min_length=1, max_length=64)]
    track: Literal["sensors", "map", "privileged"] = "map"
    sensors: Annotated[list[Text], Field(min_length=1, max_length=50)] = ["speedometer", "route"]
    control: Text = "target_speed_steering"


class StepRequest(BaseModel):
    """How far a paused world goes on.

    Attributes:
        ticks: Number of ticks.
    """

    model_config = ConfigDict(extra="forbid", json_schema_extra={"examples": [{"ticks": 10}]})

    ticks: Annotated[int, Field(ge=1, le=100_000)] = 1


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
    observations: Observations
