"""Config: base of everything read from TOML or stored in a record; with names, places and missions."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.faults import describe_fault

Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,99}$")]
"""A name that may be part of a file name."""
OPTIONAL: Any = Field(default=None, exclude_if=lambda value: value is None)
"""Default None of a field that a document omits when it is None, so that most scenarios keep their hashes."""


class Config(BaseModel):
    """Base of everything read from TOML or stored in a record: immutable, and unknown keys are errors."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, defer_build=True)

    @classmethod
    def read_toml(cls, path: Path) -> Self:
        """Reads a TOML file.

        Raises:
            InvalidInputError: It is no TOML, or has a fault; the message names the file and the place.
        """
        try:
            return cls.model_validate(tomllib.loads(path.read_text(encoding="utf-8")))
        except ValidationError as error:
            raise InvalidInputError(f"{path}: {describe_fault(error, cls)}") from error
        except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
            raise InvalidInputError(f"{path}: {error}") from error


def toml_value(value: object) -> str:
    """A text, number, truth value or list of these as TOML in ASCII; halves of characters become U+FFFD."""
    text = json.dumps(value, ensure_ascii=False)
    return "".join(one if " " <= one <= "~" else _escaped(ord(one)) for one in text)


def _escaped(code: int) -> str:
    """A character as TOML escapes it, which has no surrogate pairs, unlike JSON."""
    if 0xD800 <= code < 0xE000:
        code = 0xFFFD
    return f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


class Place(Config):
    """A point on a lane.

    Attributes:
        lane: SUMO lane id, such as "28639688#1_2".
        position_m: Arc length from the lane's start; negative counts from its end, as in SUMO.
    """

    lane: str
    position_m: float = 0.0


class Mission(Config):
    """Task of one ego: drive from start to goal.

    Attributes:
        name: The ego's name, unique in its scenario.
        start: Place of the ego's box centre at the first tick.
        goal: End of the route.
        via: SUMO ids of edges that the route must pass, in order.
        start_speed_mps: Speed at the first tick, m/s: the ego starts amid traffic that has warmed up without it, and
            replaces any vehicle that it would overlap. None: it starts at rest, and vehicles within 20 m are removed.
    """

    name: Name = "ego"
    start: Place
    goal: Place
    via: tuple[str, ...] = ()
    start_speed_mps: Annotated[float, Field(ge=0, le=60)] | None = OPTIONAL
