"""The sensors, one file each, and the registry of their names."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from dohyo.sumo_networks.conditions import Conditions
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.sensors.base import Observation, Sensor, SensorConfig, Track
from dohyo.sumo_networks.sensors.birdseye import BirdseyeConfig
from dohyo.sumo_networks.sensors.camera import CameraConfig
from dohyo.sumo_networks.sensors.conflicts import Conflicts
from dohyo.sumo_networks.sensors.detections import Detections
from dohyo.sumo_networks.sensors.ego_state import EgoState
from dohyo.sumo_networks.sensors.gnss import Gnss, GnssRtk
from dohyo.sumo_networks.sensors.imu import Imu
from dohyo.sumo_networks.sensors.junctions_ahead import JunctionsAhead
from dohyo.sumo_networks.sensors.lane import LaneSensor
from dohyo.sumo_networks.sensors.lanes import LanesSensor
from dohyo.sumo_networks.sensors.objects import Objects
from dohyo.sumo_networks.sensors.path import PathSensor
from dohyo.sumo_networks.sensors.radar import Radar
from dohyo.sumo_networks.sensors.route import Navigation, RouteSensor
from dohyo.sumo_networks.sensors.route_map import RouteMap
from dohyo.sumo_networks.sensors.speedometer import Speedometer

__all__ = [
    "PRESETS",
    "SENSORS",
    "BirdseyeConfig",
    "CameraConfig",
    "Observation",
    "Sensor",
    "SensorConfig",
    "Track",
    "make_sensors",
]

# PRIBOOT's views from above, RLAD's image in the thesis's size and in a small one, GHRL's semantic image, GRIAD's three
# cameras: small ones, with `camera_64` as their centre, and large ones.
PRESETS = (
    BirdseyeConfig(name="birdseye"),
    BirdseyeConfig(name="birdseye_rgb", mode="rgb"),
    BirdseyeConfig(name="birdseye_far", width=128, height=160, metres_per_px=0.4, ahead_m=46.0, arrow_s=1.0),
    CameraConfig(name="camera_rgb"),
    CameraConfig(name="camera_64", width=64, height=64, fov_deg=60.0),
    CameraConfig(name="camera_64_left", width=64, height=64, fov_deg=60.0, yaw_deg=60.0),
    CameraConfig(name="camera_64_right", width=64, height=64, fov_deg=60.0, yaw_deg=-60.0),
    CameraConfig(name="camera_semantic", mode="semantic", width=160, height=80),
    CameraConfig(name="camera_depth", mode="depth"),
    CameraConfig(name="camera_left", width=256, height=144, fov_deg=70.0, yaw_deg=60.0),
    CameraConfig(name="camera_front", width=256, height=144, fov_deg=70.0),
    CameraConfig(name="camera_right", width=256, height=144, fov_deg=70.0, yaw_deg=-60.0),
)

SENSORS: dict[str, type[Sensor] | SensorConfig] = {
    "speedometer": Speedometer,
    "navigation": Navigation,
    "lane": LaneSensor,
    "route": RouteSensor,
    "objects": Objects,
    "detections": Detections,
    "junctions_ahead": JunctionsAhead,
    "conflicts": Conflicts,
    "radar": Radar,
    "gnss": Gnss,
    "gnss_rtk": GnssRtk,
    "imu": Imu,
    "route_map": RouteMap,
    "ego_state": EgoState,
    "lanes": LanesSensor,
    "path": PathSensor,
    **{preset.name: preset for preset in PRESETS},
}


def make_sensors(
    names: Iterable[str | SensorConfig],
    track: Track = Track.PRIVILEGED,
    conditions: Conditions | None = None,
    rng: np.random.Generator | None = None,
) -> tuple[Sensor, ...]:
    """Makes sensors for one ego and episode.

    Args:
        names: Names from `SENSORS` or sensor configurations.
        track: Track of the agent.
        conditions: Conditions of the scenario; clear by default.
        rng: Generator of the sensors' noise. The errors of each sensor follow from this and from its name.

    Raises:
        UnknownNameError: A sensor does not exist.
        InvalidInputError: The track does not allow a sensor, or a sensor is given twice.
    """
    out: list[Sensor] = []
    entropy = (rng or np.random.default_rng(0)).integers(2**32, size=4).tolist()
    for name in names:
        if not isinstance(name, SensorConfig) and name not in SENSORS:
            raise UnknownNameError("sensor", name, SENSORS)
        maker = name if isinstance(name, SensorConfig) else SENSORS[name]
        # By name, so that neither other sensors nor their order change a sensor's noise.
        own = np.random.SeedSequence(entropy, spawn_key=tuple(maker.name.encode()))
        sensor = maker.make(conditions or Conditions(), np.random.default_rng(own))
        if sensor.track > track:
            raise InvalidInputError(
                f"sensor '{sensor.name}' needs track '{sensor.track.name.lower()}', "
                f"the agent's is '{track.name.lower()}'"
            )
        if any(sensor.name == other.name for other in out):
            raise InvalidInputError(f"sensor '{sensor.name}': expected each sensor once")
        out.append(sensor)
    return tuple(out)
