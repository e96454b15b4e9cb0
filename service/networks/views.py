"""Answers of the network routes."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from dohyo.service.web.views import Version, View


class NetworkView(View):
    """A road network."""

    name: Annotated[str, Field(examples=["ingolstadt"])]
    title: str
    licence: str
    source: str
    origin: Annotated[Literal["dohyo", "upload"], Field(description="Whether it came with dohyo.")]
    sha256: Version
    mirrored: Annotated[
        bool, Field(description="Whether it is the mirror image of a place with left-hand traffic: all drive right.")
    ]
    guessed: Annotated[list[str], Field(description="Guesses and repairs of its import, one line each.")]
    lanes: Annotated[int, Field(description="For cars, outside junctions.")]
    lane_km: float
    lights: int
    crossings: int
    bounds: Annotated[list[float], Field(description="x0, y0, x1, y1 in metres.", min_length=4, max_length=4)]
    net_offset: Annotated[
        list[float],
        Field(
            description="x, y in metres that were added to the coordinates of its source (netOffset of a SUMO net).",
            min_length=2,
            max_length=2,
        ),
    ]
