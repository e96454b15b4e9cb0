"""Bodies of the wire's requests and answers. Their OpenAPI schema is generated from these structs."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec
from msgspec import UNSET, Meta, UnsetType

from dohyo.service.wire.enumerations import ENUMERATIONS, in_words

LONGEST_CAPACITY = 64
LONGEST_TEXT = 500

ARRAY: dict[str, Any] = {
    "description": "An array: nested lists in JSON; in msgpack also {shape, dtype, data}, little-endian and row-major.",
    "oneOf": [
        {"type": "array", "items": {}},
        {
            "type": "object",
            "properties": {
                "shape": {"type": "array", "items": {"type": "integer"}},
                "dtype": {"type": "string", "examples": ["float32"]},
                "data": {"type": "string", "format": "binary"},
            },
        },
    ],
}
BY_EGO: dict[str, Any] = {"type": "object", "additionalProperties": ARRAY}

Observations = Annotated[
    msgspec.Raw,
    Meta(
        description="Arrays by ego and sensor; `GET /v1/observations` has shapes and units. "
        + "; ".join(f"{what}: {in_words(members)}" for what, members in ENUMERATIONS.items()),
        extra_json_schema={"type": "object", "additionalProperties": BY_EGO},
    ),
]
Actions = Annotated[
    msgspec.Raw,
    Meta(description="One array for each ego in the last `observations`.", extra_json_schema=BY_EGO),
]
Tick = Annotated[int, Meta(description="Number of the tick, from 0.")]
Directive = Annotated[
    Literal["run", "drain", "abort"],
    Meta(description="drain: the service ends soon; abort: the evaluation was cancelled, or the service ends."),
]


class Registration(msgspec.Struct):
    """Registration of a policy worker."""

    agent: Annotated[str, Meta(min_length=1, max_length=100, description="Name of the agent that the worker drives.")]
    capacity: Annotated[int, Meta(ge=1, le=LONGEST_CAPACITY, description="Most episodes at once.")] = 1
    version: Annotated[
        Annotated[int, Meta(ge=1, le=1_000_000)] | None,
        Meta(description="Version of the agent; without it any version that is to be driven."),
    ] = None


class Registered(msgspec.Struct):
    """A registered worker."""

    worker: Annotated[str, Meta(description="Identifier of the worker, for the path of acquire.")]
    token: Annotated[str, Meta(description="Bearer token of all later requests of this worker.")]
    lease_ttl_s: Annotated[float, Meta(description="Silence after which the worker loses its leases, s.")]


class ToldPlace(msgspec.Struct):
    """A point on a lane."""

    lane: Annotated[str, Meta(description="SUMO's identifier of the lane.")]
    position_m: Annotated[float, Meta(description="Distance from the lane's start; negative: from its end, m.")]


class ToldMission(msgspec.Struct):
    """An ego, and on the track `privileged` its mission."""

    name: Annotated[str, Meta(description="Name of the ego in observations and actions.")]
    start: Annotated[ToldPlace | UnsetType, Meta(description="Only on the track privileged.")] = UNSET
    goal: Annotated[ToldPlace | UnsetType, Meta(description="Only on the track privileged.")] = UNSET
    via: Annotated[
        list[str] | UnsetType, Meta(description="Edges that the route must pass; only on the track privileged.")
    ] = UNSET


class ToldSpec(msgspec.Struct):
    """The submission that is driven."""

    name: Annotated[str, Meta(description="Name of the agent.")]
    version: Annotated[int, Meta(description="Version of the submission.")]
    track: Annotated[str, Meta(description="sensors, map or privileged.")]
    sensors: Annotated[list[str], Meta(description="Sensors in every observation.")]
    control: Annotated[str, Meta(description="Control interface, which gives the shape of an action.")]
    settings: Annotated[dict[str, Any], Meta(description="Settings of the submission.")]


class Granted(msgspec.Struct):
    """A leased episode. It names neither network nor mission nor scenario."""

    lease: Annotated[str, Meta(description="Identifier of the lease, for the paths of its messages.")]
    attempt: Annotated[int, Meta(description="Number of the attempt at this episode, from 1.")]
    dt_s: Annotated[float, Meta(description="Simulated time between two decisions, s.")]
    deadline_ms: Annotated[int, Meta(description="Time for one decision, ms.")]
    first_deadline_ms: Annotated[int, Meta(description="Time for the first decision, in which models load, ms.")]
    slow_policy: Annotated[
        Literal["wait", "realtime"], Meta(description="Whether the simulation waits for a slow decision.")
    ]
    spec: Annotated[ToldSpec, Meta(description="The submission that is driven.")]
    tick: Tick
    missions: Annotated[list[ToldMission], Meta(description="One for each ego.")]
    seed: Annotated[int, Meta(description="Seed of the agent's randomness; unrelated to that of the traffic.")]
    observations: Observations


class Step(msgspec.Struct):
    """Actions for one tick; they stay encoded until the episode's process checks them."""

    tick: Annotated[int, Meta(description="The tick last received.")]
    actions: Actions


class Reply(msgspec.Struct):
    """Answer to a step. `observations` is msgpack as the episode's process wrote it."""

    tick: Tick
    time_s: Annotated[float, Meta(description="Simulated time, s.")]
    observations: Observations
    done: Annotated[bool, Meta(description="Whether the episode is over and its record is kept.")]
    missed: Annotated[int, Meta(description="Ticks so far without a decision; 0 unless `realtime`.")]
    clipped: Annotated[
        int, Meta(description="Actions so far with a value out of range; the nearest bound was driven instead.")
    ]
    directive: Directive
    rewards: Annotated[None, Meta(description="Always null: a drive that counts gives no rewards.")] = None


class Release(msgspec.Struct):
    """Release of a lease."""

    reason: Annotated[str, Meta(max_length=LONGEST_TEXT, description="Why; `invalid_action` with an error.")] = ""
    error: Annotated[
        Annotated[str, Meta(max_length=10_000)] | None,
        Meta(description="The failure of the agent, which ends the episode; without it, it is driven again."),
    ] = None
