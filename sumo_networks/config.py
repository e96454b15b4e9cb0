"""Config: what is read from TOML or stored in a record; and the names, places and missions in it."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,99}$")]
"""A name that can stand in a file's name."""
OPTIONAL: Any = Field(default=None, exclude_if=lambda value: value is None)
"""Default of a field that is left out of the document where it is None, so that most scenarios keep their hashes."""


class Config(BaseModel):
    """Base of everything read from TOML or stored in a record: immutable, and unknown keys are errors."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Place(Config):
    """A point on a lane.

    Attributes:
        lane: SUMO lane id, such as "28639688#1_2".
        position_m: Arc length from the lane's start; negative counts from its end, as in SUMO.
    """

    lane: str
    position_m: float = 0.0


class Mission(Config):
    """What one ego has to do: drive from start to goal.

    Attributes:
        name: The ego's name, unique in its scenario.
        start: Where the ego's box centre is at the first tick.
        goal: Where the route ends.
        via: Edges the route must pass, in order.
        start_speed_mps: None: it starts at rest, and vehicles within 20 m are moved away. A speed: it starts amid the
            traffic, which has warmed up without it, and replaces any vehicle that it would overlap.
    """

    name: Name = "ego"
    start: Place
    goal: Place
    via: tuple[str, ...] = ()
    start_speed_mps: Annotated[float, Field(ge=0, le=60)] | None = OPTIONAL
