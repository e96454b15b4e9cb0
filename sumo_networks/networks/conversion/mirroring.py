"""Mirroring: a net with left-hand traffic becomes its mirror image, in which traffic drives on the right.

Everything in dohyo drives on the right: sensors, rules, events and agents. The mirror image of left-hand traffic is
right-hand traffic with the same lengths, lanes, lights and rights of way, so nothing else has to know about it. East
and west change places, and so do left and right turns.
"""

from __future__ import annotations

import re
from typing import Final

_ROOT: Final = re.compile(rb"<net\b[^>]*>")
_BOUNDARY: Final = re.compile(rb'convBoundary="(-?[\d.]+),[^,]*,(-?[\d.]+),')
_SHAPE: Final = re.compile(rb'\b(shape|outlineShape)="([^"]*)"')  # customShape is a bool
_LEFT_HAND: Final = re.compile(rb'\slefthand="[^"]*"')
_JUNCTION_X: Final = re.compile(rb'(<junction\b[^>]*? x=")(-?[\d.]+)"')
_DIRECTION: Final = re.compile(rb'\bdir="([lrLRT])"')
_PROJECTION: Final = re.compile(rb'\bprojParameter="[^"]*"')
_OTHER_SIDE: Final = {b"l": b"r", b"r": b"l", b"L": b"R", b"R": b"L", b"T": b"t"}


def mirror_image(net: bytes) -> bytes:
    """The mirror image of a SUMO net with left-hand traffic, within the same boundary.

    The image has no place on the earth: its latitudes and longitudes would be wrong.
    """
    boundary = _BOUNDARY.search(net)
    both_ends = float(boundary[1]) + float(boundary[2]) if boundary else 0.0

    def flipped(x: bytes) -> bytes:
        return f"{both_ends - float(x) + 0.0:.2f}".encode()

    def flip_shape(match: re.Match[bytes]) -> bytes:
        points = (point.partition(b",") for point in match[2].split())
        return match[1] + b'="' + b" ".join(flipped(x) + b"," + rest for x, _, rest in points) + b'"'

    net = _ROOT.sub(lambda match: _LEFT_HAND.sub(b"", match[0]), net, count=1)
    net = _SHAPE.sub(flip_shape, net)
    net = _JUNCTION_X.sub(lambda match: match[1] + flipped(match[2]) + b'"', net)
    net = _DIRECTION.sub(lambda match: b'dir="' + _OTHER_SIDE[match[1]] + b'"', net)
    return _PROJECTION.sub(b'projParameter="!"', net, count=1)
