"""The sensors, one file each, and the registry by which agents ask for them."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from sumo_networks.conditions import Conditions
from sumo_networks.errors import InvalidInputError, UnknownNameError
from sumo_networks.sensors.base import Sensor, Track
from sumo_networks.sensors.conflicts import Conflicts
from sumo_networks.sensors.detections import Detections
from sumo_networks.sensors.lane import Lane
from sumo_networks.sensors.lights import Lights
from sumo_networks.sensors.objects import Objects
from sumo_networks.sensors.route import Navigation, Route
from sumo_networks.sensors.speedometer import Speedometer

__all__ = ["SENSORS", "Sensor", "Track", "make_sensors"]

SENSORS: dict[str, type[Sensor]] = {
    "speedometer": Speedometer,
    "navigation": Navigation,
    "lane": Lane,
    "route": Route,
    "objects": Objects,
    "detections": Detections,
    "lights": Lights,
    "conflicts": Conflicts,
}


def make_sensors(
    names: Iterable[str],
    track: Track = Track.PRIVILEGED,
    conditions: Conditions | None = None,
    rng: np.random.Generator | None = None,
) -> tuple[Sensor, ...]:
    """Sensors by name, for one ego and episode.

    Args:
        names: Of `SENSORS`.
        track: The agent's.
        conditions: By default clear.
        rng: Of the sensors' noise.

    Raises:
        UnknownNameError: There is no such sensor.
        InvalidInputError: The track may not use one of them.
    """
    out = []
    for name in names:
        if name not in SENSORS:
            raise UnknownNameError("sensor", name, SENSORS)
        sensor = SENSORS[name].make(conditions or Conditions(), rng or np.random.default_rng(0))
        if sensor.track > track:
            raise InvalidInputError(
                f"sensor '{name}' needs track '{sensor.track.name.lower()}', the agent's is '{track.name.lower()}'"
            )
        out.append(sensor)
    return tuple(out)
