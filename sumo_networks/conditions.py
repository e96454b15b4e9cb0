"""Conditions: the model of weather. Four conditions are for training and two for testing, as in NoCrash.

SUMO draws no rain, so conditions model the effects of rain on driving: tyres grip less, all drivers slow down, and
others are detected later, less exactly, and sometimes not at all.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated

from pydantic import Field

from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.errors import UnknownNameError

Share = Annotated[float, Field(ge=0, le=1)]


class Conditions(Config):
    """One condition of road, light and air.

    Attributes:
        friction: Share of the dry road's grip, for the ego's tyres and for SUMO's drivers (they slow down).
        visibility_m: Range of sight in daylight, m.
        daylight: 1 at noon, 0 at night; at 0 the range of sight is half.
        position_noise_m: Standard deviation of a detected position at 20 m, m; it grows with the distance.
        speed_noise: Standard deviation of a detected speed, as a share of the speed.
        dropout: Share of missing detections, drawn anew in every tick.
    """

    friction: Annotated[float, Field(gt=0, le=1)] = 1.0
    visibility_m: Annotated[float, Field(gt=0)] = 100.0
    daylight: Share = 1.0
    position_noise_m: Annotated[float, Field(ge=0)] = 0.0
    speed_noise: Annotated[float, Field(ge=0)] = 0.0
    dropout: Share = 0.0

    @property
    def sight_m(self) -> float:
        """Range of sight, m."""
        return self.visibility_m * (0.5 + 0.5 * self.daylight)


TRAIN: Mapping[str, Conditions] = MappingProxyType(
    {
        "clear": Conditions(),
        "wet": Conditions(friction=0.75, position_noise_m=0.1, speed_noise=0.02, dropout=0.01),
        "heavy-rain": Conditions(
            friction=0.6, visibility_m=50.0, daylight=0.6, position_noise_m=0.4, speed_noise=0.08, dropout=0.08
        ),
        "sunset": Conditions(daylight=0.4, position_noise_m=0.2, speed_noise=0.04, dropout=0.03),
    }
)
TEST: Mapping[str, Conditions] = MappingProxyType(
    {
        "drizzle-sunset": Conditions(
            friction=0.7, visibility_m=70.0, daylight=0.3, position_noise_m=0.3, speed_noise=0.06, dropout=0.05
        ),
        "wet-sunset": Conditions(friction=0.75, daylight=0.3, position_noise_m=0.25, speed_noise=0.05, dropout=0.04),
    }
)
CONDITIONS: Mapping[str, Conditions] = MappingProxyType({**TRAIN, **TEST})


def conditions_named(name: str) -> Conditions:
    """Conditions by name.

    Raises:
        UnknownNameError: No conditions have that name.
    """
    if name not in CONDITIONS:
        raise UnknownNameError("condition", name, CONDITIONS)
    return CONDITIONS[name]
