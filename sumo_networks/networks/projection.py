"""Projection: between a network's metres and WGS84, by the net's own UTM zone or else around a local origin."""

from __future__ import annotations

import gzip
import math
import re
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.errors import InvalidInputError

SEMI_MAJOR_M = 6378137.0
FLATTENING = 1 / 298.257223563
ECCENTRICITY_2 = FLATTENING * (2 - FLATTENING)
_HEAD_BYTES = 65536
_UTM_SCALE, _UTM_EASTING_M, _UTM_SOUTH_M = 0.9996, 500_000.0, 10_000_000.0


@dataclass(frozen=True, slots=True)
class Projection:
    """How a network's frame lies on the earth.

    Attributes:
        zone: UTM zone, 1 to 60; 0 where the net has none, and its frame is taken for a plane that touches the earth at
            latitude 0, longitude 0.
        south: Whether the zone is one of the southern half.
        offset: What SUMO added to the projected coordinates, m.
    """

    zone: int = 0
    south: bool = False
    offset: tuple[float, float] = (0.0, 0.0)

    @property
    def georeferenced(self) -> bool:
        """Whether the coordinates are those of the real place."""
        return self.zone > 0

    def to_wgs84(self, x: float, y: float) -> tuple[float, float]:
        """Latitude and longitude [degrees] of a point of the network frame [m]."""
        if not self.georeferenced:
            latitude, longitude, _ = enu_to_geodetic(np.array([x, y, 0.0]), (0.0, 0.0, 0.0))
            return latitude, longitude
        south = _UTM_SOUTH_M if self.south else 0.0
        return _utm_inverse(x - self.offset[0], y - self.offset[1] - south, self.zone)

    def from_wgs84(self, latitude: float, longitude: float) -> tuple[float, float]:
        """Position x, y [m, network frame] of a point given in degrees."""
        if not self.georeferenced:
            east, north, _ = geodetic_to_enu(np.array([[latitude, longitude, 0.0]]), (0.0, 0.0, 0.0))[0]
            return float(east), float(north)
        easting, northing = _utm_forward(latitude, longitude, self.zone)
        return easting + self.offset[0], northing + self.offset[1] + (_UTM_SOUTH_M if self.south else 0.0)


@lru_cache(maxsize=64)
def read_projection(path: Path) -> Projection:
    """The UTM zone that a SUMO net names in its <location>; a local origin where it names none or another projection.

    Raises:
        InvalidInputError: The file cannot be read.
    """
    try:
        with gzip.open(path, "rb") if path.suffix == ".gz" else path.open("rb") as file:
            head = file.read(_HEAD_BYTES).decode(errors="replace")
    except OSError as error:
        raise InvalidInputError(f"cannot read network file '{path}': {error}") from error
    found = re.search(r'<location netOffset="([-\d.]+),([-\d.]+)"[^>]*projParameter="([^"]*)"', head)
    zone = re.search(r"\+proj=utm\b.*\+zone=(\d+)", found[3]) if found else None
    if found is None or zone is None:
        return Projection()
    return Projection(int(zone[1]), "+south" in found[3], (float(found[1]), float(found[2])))


def geodetic_to_enu(points: FloatArray, origin: tuple[float, float, float]) -> FloatArray:
    """East, north and up from an origin, exactly (through the earth-centred frame).

    Args:
        points: (N, 3) latitude, longitude [degrees], height [m].
        origin: The same, one.

    Returns:
        (N, 3), m.
    """
    difference = _earth_centred(points) - _earth_centred(np.array([origin]))
    return difference @ _axes(*origin[:2]).T


def enu_to_geodetic(point: FloatArray, origin: tuple[float, float, float]) -> tuple[float, float, float]:
    """Latitude, longitude [degrees] and height [m] of (3,) east, north, up [m] from an origin (Bowring's iteration)."""
    x, y, z = _earth_centred(np.array([origin]))[0] + point @ _axes(*origin[:2])
    across, latitude, height = math.hypot(x, y), math.atan2(z, math.hypot(x, y) * (1 - ECCENTRICITY_2)), 0.0
    for _ in range(4):
        radius = SEMI_MAJOR_M / math.sqrt(1 - ECCENTRICITY_2 * math.sin(latitude) ** 2)
        latitude = math.atan2(z + ECCENTRICITY_2 * radius * math.sin(latitude), across)
        height = across * math.cos(latitude) + z * math.sin(latitude) - SEMI_MAJOR_M**2 / radius
    return math.degrees(latitude), math.degrees(math.atan2(y, x)), height


def _earth_centred(points: FloatArray) -> FloatArray:
    latitude, longitude = np.radians(points[:, 0]), np.radians(points[:, 1])
    radius = SEMI_MAJOR_M / np.sqrt(1 - ECCENTRICITY_2 * np.sin(latitude) ** 2)
    across = (radius + points[:, 2]) * np.cos(latitude)
    up = (radius * (1 - ECCENTRICITY_2) + points[:, 2]) * np.sin(latitude)
    return np.column_stack([across * np.cos(longitude), across * np.sin(longitude), up])


def _axes(latitude: float, longitude: float) -> FloatArray:
    """(3, 3) the directions east, north and up in the earth-centred frame, one per row."""
    cos_lat, sin_lat = math.cos(math.radians(latitude)), math.sin(math.radians(latitude))
    cos_lon, sin_lon = math.cos(math.radians(longitude)), math.sin(math.radians(longitude))
    rows = [
        [-sin_lon, cos_lon, 0.0],
        [-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat],
        [cos_lat * cos_lon, cos_lat * sin_lon, sin_lat],
    ]
    return np.array(rows)


# Krueger's series for the transverse Mercator projection, to the third order in n: below 1 mm within a zone.
_N = FLATTENING / (2 - FLATTENING)
_RECTIFYING_M = SEMI_MAJOR_M / (1 + _N) * (1 + _N**2 / 4 + _N**4 / 64)
_ALPHA = (_N / 2 - 2 * _N**2 / 3 + 5 * _N**3 / 16, 13 * _N**2 / 48 - 3 * _N**3 / 5, 61 * _N**3 / 240)
_BETA = (_N / 2 - 2 * _N**2 / 3 + 37 * _N**3 / 96, _N**2 / 48 + _N**3 / 15, 17 * _N**3 / 480)
_DELTA = (2 * _N - 2 * _N**2 / 3 - 2 * _N**3, 7 * _N**2 / 3 - 8 * _N**3 / 5, 56 * _N**3 / 15)


def _utm_forward(latitude: float, longitude: float, zone: int) -> tuple[float, float]:
    """Easting and northing [m] of a point in degrees. Source: Karney 2011, Krueger 1912."""
    phi, away = math.radians(latitude), math.radians(longitude - (6 * zone - 183))
    root = 2 * math.sqrt(_N) / (1 + _N)
    t = math.sinh(math.atanh(math.sin(phi)) - root * math.atanh(root * math.sin(phi)))
    xi, eta = math.atan2(t, math.cos(away)), math.atanh(math.sin(away) / math.hypot(1.0, t))
    north = xi + sum(a * math.sin(2 * j * xi) * math.cosh(2 * j * eta) for j, a in enumerate(_ALPHA, 1))
    east = eta + sum(a * math.cos(2 * j * xi) * math.sinh(2 * j * eta) for j, a in enumerate(_ALPHA, 1))
    return _UTM_EASTING_M + _UTM_SCALE * _RECTIFYING_M * east, _UTM_SCALE * _RECTIFYING_M * north


def _utm_inverse(easting: float, northing: float, zone: int) -> tuple[float, float]:
    """Latitude and longitude [degrees] of a point of a UTM zone [m]. Source: as `_utm_forward`."""
    north = northing / (_UTM_SCALE * _RECTIFYING_M)
    east = (easting - _UTM_EASTING_M) / (_UTM_SCALE * _RECTIFYING_M)
    xi = north - sum(b * math.sin(2 * j * north) * math.cosh(2 * j * east) for j, b in enumerate(_BETA, 1))
    eta = east - sum(b * math.cos(2 * j * north) * math.sinh(2 * j * east) for j, b in enumerate(_BETA, 1))
    conformal = math.asin(math.sin(xi) / math.cosh(eta))
    latitude = conformal + sum(d * math.sin(2 * j * conformal) for j, d in enumerate(_DELTA, 1))
    return math.degrees(latitude), 6 * zone - 183 + math.degrees(math.atan2(math.sinh(eta), math.cos(xi)))
