"""Track file: an estimated track as CSV.

Columns: t [s]; x, y [m, east and north of the origin]; heading [rad, counter-clockwise from east]; sigma_x, sigma_y
[m]; and lat, lon [degrees] where the fixes had them.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl

from dohyo.agents.localization.logs import Origin
from dohyo.agents.localization.track import EstimatedTrack
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import write_atomically
from dohyo.sumo_networks.networks.projection import enu_to_geodetic

METRES, DEGREES, SECONDS = 4, 9, 6
"""Decimals."""


def write_track(path: Path, track: EstimatedTrack, origin: Origin | None) -> None:
    """Writes a track.

    Args:
        path: The CSV file.
        track: To write.
        origin: Latitude, longitude [degrees] and height [m] of x = y = 0; None: not known.

    Raises:
        InvalidInputError: It cannot be written.
    """
    std = np.sqrt(np.einsum("kii->ki", track.covariance))
    columns = {
        "t": track.time.round(SECONDS),
        "x": track.position[:, 0].round(METRES),
        "y": track.position[:, 1].round(METRES),
        "heading": (np.remainder(track.heading + np.pi, 2.0 * np.pi) - np.pi).round(METRES + 1),
        "sigma_x": std[:, 0].round(METRES),
        "sigma_y": std[:, 1].round(METRES),
    }
    if origin is not None:
        flat = np.column_stack([track.position, np.zeros(len(track.position))])
        geodetic = np.array([enu_to_geodetic(place, origin) for place in flat])
        columns |= {"lat": geodetic[:, 0].round(DEGREES), "lon": geodetic[:, 1].round(DEGREES)}
    text = pl.DataFrame(columns).write_csv()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, text.encode())
    except OSError as error:
        raise InvalidInputError(f"cannot write '{path}': {error.strerror}") from error
