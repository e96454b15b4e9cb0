"""OpenAPI schema of the wire, written by hand: its routes decode their bodies themselves."""

from __future__ import annotations

from typing import Any

from dohyo.service.wire.messages import Format

_ARRAY = {
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
_BY_EGO = {"type": "object", "additionalProperties": _ARRAY}
_OBSERVATIONS = {"type": "object", "additionalProperties": _BY_EGO, "description": "Arrays by ego and sensor."}
_PLACE = {"type": "object", "properties": {"lane": {"type": "string"}, "position_m": {"type": "number"}}}
_MISSION = {
    "type": "object",
    "properties": {
        "name": {"type": "string", "description": "The ego's."},
        "start": _PLACE,
        "goal": _PLACE,
        "via": {"type": "array", "items": {"type": "string"}},
    },
}


def _object(required: list[str], **properties: Any) -> dict[str, Any]:
    return {"type": "object", "required": required, "properties": properties}


def _content(schema: dict[str, Any], example: dict[str, Any]) -> dict[str, Any]:
    return {media_type.value: {"schema": schema, "example": example} for media_type in reversed(Format)}


def _body(schema: dict[str, Any], example: dict[str, Any], required: bool = True) -> dict[str, Any]:
    return {
        "requestBody": {"required": required, "content": {"application/json": {"schema": schema, "example": example}}}
    }


WORKER_TOKEN: dict[str, Any] = {"security": [{"HTTPBearer": []}]}

REGISTER = _body(
    _object(
        ["agent"],
        agent={"type": "string", "minLength": 1, "maxLength": 100},
        capacity={"type": "integer", "minimum": 1, "maximum": 64, "default": 1, "description": "Episodes at once."},
        version={"type": ["integer", "null"], "minimum": 1, "description": "Of the agent; without: whichever."},
    ),
    {"agent": "my-agent", "capacity": 1},
)
REGISTERED = {
    "description": "Registered.",
    "content": _content(
        _object(
            ["worker", "token", "lease_ttl_s"],
            worker={"type": "string"},
            token={"type": "string", "description": "The bearer token of all that this worker does next."},
            lease_ttl_s={"type": "number", "description": "A worker silent for longer loses its lease."},
        ),
        {"worker": "w-9f86d081884c7d65", "token": "Zk3...", "lease_ttl_s": 30.0},
    ),
}

ACQUIRED = {
    "description": "An episode.",
    "content": _content(
        _object(
            [
                "lease",
                "attempt",
                "dt_s",
                "deadline_ms",
                "slow_policy",
                "spec",
                "tick",
                "missions",
                "seed",
                "observations",
            ],
            lease={"type": "string"},
            attempt={"type": "integer"},
            dt_s={"type": "number"},
            deadline_ms={"type": "integer", "description": "For one decision."},
            first_deadline_ms={"type": "integer", "description": "For the first one, models being loaded."},
            slow_policy={"enum": ["wait", "realtime"]},
            spec={"type": "object", "description": "name, version, track, sensors, control, settings."},
            tick={"type": "integer"},
            missions={"type": "array", "items": _MISSION},
            seed={"type": "integer"},
            observations=_OBSERVATIONS,
        ),
        {
            "lease": "l-3f9a1c0b7d2e4f5a6b7c8d9e",
            "attempt": 1,
            "dt_s": 0.1,
            "deadline_ms": 10000,
            "first_deadline_ms": 60000,
            "slow_policy": "wait",
            "spec": {"name": "my-agent", "track": "map", "sensors": ["route"], "control": "target_speed_steering"},
            "tick": 0,
            "missions": [{"name": "ego", "start": {"lane": "a_0"}, "goal": {"lane": "b_0"}, "via": []}],
            "seed": 0,
            "observations": {"ego": {"speedometer": [0.0]}},
        },
    ),
}

STEP = WORKER_TOKEN | _body(
    _object(["tick", "actions"], tick={"type": "integer", "minimum": 0}, actions=_BY_EGO),
    {"tick": 0, "actions": {"ego": [8.0, 0.0]}},
)
STEPPED = {
    "description": "What is to be seen next.",
    "content": _content(
        _object(
            ["tick", "time_s", "observations", "rewards", "done", "missed", "directive"],
            tick={"type": "integer"},
            time_s={"type": "number"},
            observations=_OBSERVATIONS,
            rewards={"type": "null"},
            done={"type": "boolean", "description": "The episode is over, and its record is kept."},
            missed={"type": "integer", "description": "Ticks that went by without a decision; 0 unless `realtime`."},
            directive={"enum": ["run", "drain", "abort"]},
        ),
        {
            "tick": 1,
            "time_s": 0.1,
            "observations": {"ego": {"speedometer": [0.2]}},
            "rewards": None,
            "done": False,
            "missed": 0,
            "directive": "run",
        },
    ),
}

RELEASE = WORKER_TOKEN | _body(
    _object(
        [],
        reason={"type": "string", "maxLength": 500, "examples": ["shutdown", "invalid_action"]},
        error={"type": ["string", "null"], "maxLength": 10000, "description": "The agent has failed, and how."},
    ),
    {"reason": "shutdown"},
    required=False,
)
