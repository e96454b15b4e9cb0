"""Mirroring: a net with left-hand traffic becomes its mirror image, in which traffic drives on the right.

Everything in dohyo drives on the right: sensors, rules, events and agents. The mirror image of left-hand traffic is
right-hand traffic with the same lengths, lanes, lights and rights of way, so nothing else has to know about it. East
and west change places, and so do left and right turns.
"""

from __future__ import annotations

import io
import xml.sax
from typing import Final
from xml.sax.saxutils import XMLGenerator
from xml.sax.xmlreader import AttributesImpl

_SHAPES: Final = ("shape", "outlineShape")  # customShape is a bool
_OTHER_SIDE: Final = {"l": "r", "r": "l", "L": "R", "R": "L", "T": "t"}


def mirror_image(net: bytes) -> bytes:
    """The mirror image of a SUMO net with left-hand traffic, within the same boundary; the net passed `xml_guard.scan`.

    The image has no place on the earth: its latitudes and longitudes would be wrong.

    Raises:
        ValueError: A coordinate is no number.
    """
    boundary, image = _Boundary(), io.BytesIO()
    xml.sax.parseString(net, boundary)
    xml.sax.parseString(net, _Mirror(image, boundary.both_ends))
    return image.getvalue()


class _Boundary(xml.sax.ContentHandler):
    """Finds the smallest x and the largest x of a net, and adds them; 0 if it does not say them."""

    def __init__(self) -> None:
        super().__init__()
        self.both_ends = 0.0

    def startElement(self, name: str, attrs: AttributesImpl[str]) -> None:  # noqa: N802
        if name == "location" and "convBoundary" in attrs:
            left, _, right, _ = attrs["convBoundary"].split(",")
            self.both_ends = float(left) + float(right)


class _Mirror(XMLGenerator):
    """Writes the mirror image of the net that it is given, in UTF-8 and without comments."""

    def __init__(self, target: io.BytesIO, both_ends: float) -> None:
        super().__init__(target, encoding="UTF-8", short_empty_elements=True)
        self.both_ends = both_ends

    def startElement(self, name: str, attrs: AttributesImpl[str]) -> None:  # noqa: N802
        flipped = {key: self._shape(value) if key in _SHAPES else value for key, value in attrs.items()}
        if name == "net":
            flipped.pop("lefthand", None)
        if name == "location":
            flipped["projParameter"] = "!"
        if name == "junction" and "x" in flipped:
            flipped["x"] = self._x(flipped["x"])
        if "dir" in flipped:
            flipped["dir"] = _OTHER_SIDE.get(flipped["dir"], flipped["dir"])
        super().startElement(name, AttributesImpl(flipped))

    def _shape(self, points: str) -> str:
        pairs = (point.partition(",") for point in points.split())
        return " ".join(f"{self._x(x)},{rest}" for x, _, rest in pairs)

    def _x(self, x: str) -> str:
        return f"{self.both_ends - float(x) + 0.0:.2f}"
