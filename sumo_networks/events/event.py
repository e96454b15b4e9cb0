"""BaseEvent: base of all event configurations, and the types of their numbers.

Defaults are fields of a kind's class; a scenario may change each of them. Values marked "ours" in
docs/reference/events.md are not the source's. Source: CARLA Leaderboard 2.x scenarios; NHTSA pre-crash scenarios;
Albilani's obstacle test.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, Field, model_validator

from dohyo.sumo_networks.config import Config, Name, Place


def _ordered(gaps: tuple[float, float]) -> tuple[float, float]:
    if gaps[0] > gaps[1]:
        raise ValueError(f"expected gaps from small to large, got {list(gaps)}")
    return gaps


Metres = Annotated[float, Field(ge=0, le=1000)]
Seconds = Annotated[float, Field(ge=0, le=3600)]
Speed = Annotated[float, Field(gt=0, le=60)]
Size = Annotated[float, Field(gt=0, le=20)]
Side = Literal["left", "right"]
VehicleType = Literal["car", "van", "truck", "bus"]
_Gap = Annotated[float, Field(gt=0, le=500)]
Gaps = Annotated[tuple[_Gap, _Gap], AfterValidator(_ordered)]
"""Smallest and largest gap between two vehicles, m."""


class BaseEvent(Config):
    """Base of all event configurations.

    Attributes:
        behavior: Class or function that makes the behaviour from the event and its `EventSite`.
        only_at_start: Whether the kind fits only at the start of a route.
        kind: Name of the kind.
        name: Name, unique in its scenario.
        ego: Mission name of the ego that triggers the event; None: the first mission.
        at_m: Trigger as arc length on the ego's route, m; None: `at` is given.
        at: Trigger as a place on a lane of the route; None: `at_m` is given.
        timeout_s: Simulated time after which an active event ends, s.
    """

    behavior: ClassVar[Callable[..., Any]]
    only_at_start: ClassVar[bool] = False

    kind: str
    name: Name
    ego: Name | None = None
    at_m: Annotated[float, Field(ge=0)] | None = None
    at: Place | None = None
    timeout_s: Annotated[float, Field(gt=0, le=3600)] = 240.0

    @model_validator(mode="after")
    def _one_trigger(self) -> BaseEvent:
        if (self.at_m is None) == (self.at is None):
            raise ValueError(f"event '{self.name}': expected either at_m or at")
        return self
