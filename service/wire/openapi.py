"""OpenAPI entries of the wire, from its structs: the routes decode their bodies themselves."""

from __future__ import annotations

from typing import Any

import msgspec

from dohyo.service.wire.bodies import Granted, Registered, Registration, Release, Reply, Step
from dohyo.service.wire.messages import Format

WORKER_TOKEN: dict[str, Any] = {"security": [{"HTTPBearer": []}]}


def schema_of(struct: type[msgspec.Struct]) -> dict[str, Any]:
    """JSON schema of a struct, with all that it refers to inside."""
    (schema,), components = msgspec.json.schema_components([struct])
    inlined: dict[str, Any] = _inlined(schema, components)
    return inlined


def _inlined(schema: Any, components: dict[str, Any]) -> Any:
    if isinstance(schema, list):
        return [_inlined(one, components) for one in schema]
    if not isinstance(schema, dict):
        return schema
    if "$ref" in schema:
        return _inlined(components[schema["$ref"].rpartition("/")[2]], components)
    return {key: _inlined(value, components) for key, value in schema.items()}


def body(struct: type[msgspec.Struct], example: dict[str, Any], required: bool = True) -> dict[str, Any]:
    """Entry of a body."""
    content = {"application/json": {"schema": schema_of(struct), "example": example}}
    return {"requestBody": {"required": required, "content": content}}


def answer(description: str, struct: type[msgspec.Struct], example: dict[str, Any]) -> dict[str, Any]:
    """Entry of an answer, in both encodings."""
    schema = schema_of(struct)
    content = {media_type.value: {"schema": schema, "example": example} for media_type in reversed(Format)}
    return {"description": description, "content": content}


REGISTER = body(Registration, {"agent": "my-agent", "capacity": 1})
REGISTERED = answer("Registered.", Registered, {"worker": "w-9f86d081884c7d65", "token": "Zk3...", "lease_ttl_s": 30.0})
ACQUIRED = answer(
    "An episode.",
    Granted,
    {
        "lease": "l-3f9a1c0b7d2e4f5a6b7c8d9e",
        "attempt": 1,
        "dt_s": 0.1,
        "deadline_ms": 10000,
        "first_deadline_ms": 60000,
        "slow_policy": "wait",
        "spec": {
            "name": "my-agent",
            "version": 1,
            "track": "map",
            "sensors": ["route"],
            "control": "target_speed_steering",
            "settings": {},
        },
        "tick": 0,
        "missions": [{"name": "ego"}],
        "seed": 1374209845,
        "observations": {"ego": {"speedometer": [0.0]}},
    },
)
STEP = WORKER_TOKEN | body(Step, {"tick": 0, "actions": {"ego": [8.0, 0.0]}})
STEPPED = answer(
    "The next observations.",
    Reply,
    {
        "tick": 1,
        "time_s": 0.1,
        "observations": {"ego": {"speedometer": [0.2]}},
        "rewards": None,
        "done": False,
        "missed": 0,
        "clipped": 0,
        "directive": "run",
    },
)
RELEASE = WORKER_TOKEN | body(Release, {"reason": "shutdown"}, required=False)
