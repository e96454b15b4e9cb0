"""Projection: between a network's metres and degrees, by the net's own projection or around a local origin."""

from __future__ import annotations

import gzip
import math
import xml.parsers.expat
import zlib
from dataclasses import dataclass
from functools import lru_cache
from io import BufferedIOBase
from pathlib import Path

import numpy as np
from pyproj import Transformer
from pyproj.enums import TransformDirection
from pyproj.exceptions import ProjError

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.errors import InvalidInputError

UNPLACED = ("", "!", "-")
"""What SUMO writes in place of a projection: none, or its own rough one, which no other program knows."""
_CHUNK = 1 << 16
_RADIANS = "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad"
_INVERSE = TransformDirection.INVERSE


@dataclass(frozen=True, slots=True)
class Projection:
    """Position of a network's frame on the earth.

    Attributes:
        parameters: The net's projection as a PROJ string, such as "+proj=utm +zone=33 +ellps=WGS84"; empty if it has
            none: its frame is then a plane that touches the earth at latitude 0, longitude 0.
        offset: x, y that SUMO added to the projected coordinates, m.
    """

    parameters: str = ""
    offset: tuple[float, float] = (0.0, 0.0)

    @property
    def georeferenced(self) -> bool:
        """Whether latitude and longitude are those of the real place."""
        return bool(self.parameters)

    def to_wgs84(self, x: float, y: float) -> tuple[float, float]:
        """Latitude and longitude [degrees] of a point of the network frame [m]."""
        if not self.georeferenced:
            latitude, longitude, _ = enu_to_geodetic(np.array([x, y, 0.0]), (0.0, 0.0, 0.0))
            return latitude, longitude
        easting, northing = x - self.offset[0], y - self.offset[1]
        longitude, latitude = _projected(self.parameters).transform(easting, northing, direction=_INVERSE)
        return latitude, longitude

    def from_wgs84(self, latitude: float, longitude: float) -> tuple[float, float]:
        """Position x, y [m, network frame] of a point given in degrees."""
        if not self.georeferenced:
            east, north, _ = geodetic_to_enu(np.array([[latitude, longitude, 0.0]]), (0.0, 0.0, 0.0))[0]
            return float(east), float(north)
        easting, northing = _projected(self.parameters).transform(longitude, latitude)
        return easting + self.offset[0], northing + self.offset[1]


def read_projection(path: Path) -> Projection:
    """Projection of a SUMO net, from its <location>; a local origin where that names none.

    Raises:
        InvalidInputError: The file or its <location> cannot be read, or PROJ does not know the projection.
    """
    try:
        state = path.stat()
        return _read_projection(path, state.st_mtime_ns, state.st_size)
    except (OSError, EOFError, ValueError, zlib.error, xml.parsers.expat.ExpatError) as error:
        raise InvalidInputError(f"cannot read the location of network file '{path}': {error}") from error


def read_offset(path: Path) -> tuple[float, float] | None:
    """x, y that were added to the coordinates of a SUMO net's source, m; None without a <location>.

    Raises:
        InvalidInputError: The file or its <location> cannot be read.
    """
    try:
        with _opened(path) as file:
            location = _read_location(file)
        return _offset(location) if location else None
    except (OSError, EOFError, ValueError, zlib.error, xml.parsers.expat.ExpatError) as error:
        raise InvalidInputError(f"cannot read the location of network file '{path}': {error}") from error


@lru_cache(maxsize=64)
def _read_projection(path: Path, changed_ns: int, size: int) -> Projection:
    """See `read_projection`; a file that changes is read again."""
    with _opened(path) as file:
        location = _read_location(file)
    parameters = " ".join(location.get("projParameter", "").split())
    if parameters in UNPLACED:
        return Projection()
    try:
        _projected(parameters)
    except ProjError as error:
        raise ValueError(f"expected a projection that PROJ knows, got '{parameters}'") from error
    return Projection(parameters, _offset(location))


def _opened(path: Path) -> BufferedIOBase:
    return gzip.open(path, "rb") if path.suffix == ".gz" else path.open("rb")


def _offset(location: dict[str, str]) -> tuple[float, float]:
    x, y, *_ = (float(metres) for metres in location.get("netOffset", "0,0").split(","))
    if not math.isfinite(x + y):
        raise ValueError(f"expected a finite netOffset, got {x}, {y}")
    return x, y


def _read_location(file: BufferedIOBase) -> dict[str, str]:
    """Attributes of a net's <location>; none without one. The file is read up to it."""
    found: list[dict[str, str]] = []
    parser = xml.parsers.expat.ParserCreate()
    parser.StartElementHandler = lambda tag, attributes: found.append(attributes) if tag == "location" else None
    while not found and (chunk := file.read(_CHUNK)):
        parser.Parse(chunk)
    return found[0] if found else {}


def geodetic_to_enu(points: FloatArray, origin: tuple[float, float, float]) -> FloatArray:
    """East, north and up from an origin, computed exactly (through the earth-centred frame).

    Args:
        points: (N, 3) latitude, longitude [degrees], height [m].
        origin: Latitude, longitude [degrees], height [m] of the origin.

    Returns:
        (N, 3) east, north, up, m.
    """
    latitude, longitude, height = points.T
    return np.column_stack(_local_plane(origin).transform(longitude, latitude, height))


def enu_to_geodetic(point: FloatArray, origin: tuple[float, float, float]) -> tuple[float, float, float]:
    """Latitude, longitude [degrees] and height [m] of (3,) east, north, up [m] from an origin."""
    east, north, up = point.tolist()
    longitude, latitude, height = _local_plane(origin).transform(east, north, up, direction=_INVERSE)
    return latitude, longitude, height


@lru_cache(maxsize=64)
def _projected(parameters: str) -> Transformer:
    """Transformer from longitude and latitude [degrees] to easting and northing [m], as SUMO's: without other steps."""
    return Transformer.from_pipeline(f"{_RADIANS} +step {parameters.replace('+type=crs', '')}")


@lru_cache(maxsize=64)
def _local_plane(origin: tuple[float, float, float]) -> Transformer:
    """Transformer from longitude, latitude [degrees] and height [m] to east, north and up [m] of an origin."""
    latitude, longitude, height = map(float, origin)
    return Transformer.from_pipeline(
        f"{_RADIANS} +step +proj=cart +ellps=WGS84 "
        f"+step +proj=topocentric +ellps=WGS84 +lat_0={latitude!r} +lon_0={longitude!r} +h_0={height!r}"
    )
