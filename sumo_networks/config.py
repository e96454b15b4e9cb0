"""Config: what is read from TOML or stored in a record; and the places and names that such things are made of."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,99}$")]
"""A name that can stand in a file's name."""


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
