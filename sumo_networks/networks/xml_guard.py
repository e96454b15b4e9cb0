"""XML guard: reads every road file once, as a stream, under a size limit, and refuses harmful files.

Files are untrusted. Refused before netconvert, sumolib or another parser reads the file:
* a DOCTYPE, and so any entity;
* an element `include`, by which all programs of SUMO read another file;
* in a SUMO net, elements other than roads, such as detectors: SUMO takes them from nets too, and they name files;
* in a SUMO net, a traffic light's parameter `file`, to which SUMO writes what the light's detectors have seen.
"""

from __future__ import annotations

import bz2
import gzip
import math
import stat
import xml.parsers.expat
import zlib
from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import BinaryIO, NoReturn

from dohyo.sumo_networks.errors import InvalidInputError

LIMIT_MB = 200.0
_CHUNK = 1 << 20
_EVERY_NODE = 16
_TRUE = frozenset(("true", "t", "1", "yes", "on", "x"))
"""What SUMO reads as true."""
"""One of so many nodes of an OSM file is taken to find its place."""
_NET_ELEMENTS = frozenset(
    (
        *("net", "location", "type", "restriction", "stopOffset", "edge", "lane", "neigh", "param", "junction"),
        *("request", "connection", "prohibition", "roundabout"),
        *("tlLogic", "phase", "condition", "assignment", "function"),
    )
)


@dataclass(frozen=True, slots=True)
class Census:
    """Content of a road file before anything is guessed.

    Attributes:
        elements: Number of elements by tag.
        sidewalks: Number of lanes for pedestrians only.
        crossings: Number of pedestrian crossings.
        lights: Number of traffic lights.
        place: Latitude and longitude [degrees] of the middle of an OSM extract; None: it has no place.
        inside: Number of edges inside the junctions of a net.
        nema: Number of NEMA signal programs.
        left_hand: Whether a net or an OpenDRIVE file says that traffic drives on the left.
    """

    elements: Counter[str]
    sidewalks: int
    crossings: int
    lights: int
    place: tuple[float, float] | None = None
    inside: int = 0
    nema: int = 0
    left_hand: bool = False


def check_size(file: Path, limit_mb: float = LIMIT_MB) -> None:
    """Checks a file's size on the disk, before it is opened.

    Raises:
        InvalidInputError: The file is larger than the limit, or is no file.
    """
    try:
        state = file.stat()
    except OSError as error:
        raise InvalidInputError(f"cannot read '{file}': {error.strerror or error}") from error
    if not stat.S_ISREG(state.st_mode):
        raise InvalidInputError(f"cannot read '{file}': it is not a file")
    if state.st_size > limit_mb * 1e6:
        refuse_size(file, "", limit_mb)


def scan(file: Path, root: str, limit_mb: float = LIMIT_MB, copy: Path | None = None) -> Census:
    """Reads a file, unpacked if it is a .gz or .bz2 file, and checks that it is harmless XML.

    Args:
        file: Path that the user gave.
        root: Expected name of the root element.
        limit_mb: Largest size, packed or unpacked, MB.
        copy: File to write the plain XML to; None: no copy.

    Raises:
        InvalidInputError: The file is too large, truncated or not well-formed, has another root, has a DOCTYPE, or
            names another file to read or to write.
    """
    check_size(file, limit_mb)
    limit, scanner, size = limit_mb * 1e6, _Scanner(file, root), 0
    try:
        with ExitStack() as open_files:
            source = open_files.enter_context(_open(file))
            target = open_files.enter_context(copy.open("wb")) if copy else None
            while chunk := source.read(_CHUNK):
                size += len(chunk)
                if size > limit:
                    refuse_size(file, " unpacked", limit_mb)
                scanner.feed(chunk)
                if target:
                    target.write(chunk)
            scanner.feed(b"", last=True)
    except (EOFError, gzip.BadGzipFile, zlib.error) as error:
        raise InvalidInputError(f"'{file}' is no complete {_packing(file)} file: {error}") from error
    except OSError as error:
        if error.errno is None:  # bz2 has no error of its own
            raise InvalidInputError(f"'{file}' is no complete {_packing(file)} file: {error}") from error
        raise InvalidInputError(f"cannot read '{file}': {error.strerror or error}") from error
    return scanner.census()


def read_elements(file: Path, element: Callable[[str, dict[str, str]], None]) -> None:
    """Calls a function with the tag and the attributes of each element of a file that `scan` has accepted."""
    parser = xml.parsers.expat.ParserCreate()
    parser.StartElementHandler = element
    with _open(file) as source:
        parser.ParseFile(source)


class _Scanner:
    """Streaming XML reader: refuses harmful content and counts elements."""

    def __init__(self, file: Path, root: str) -> None:
        self.file, self.root = file, root
        self.elements: Counter[str] = Counter()
        self.sidewalks = self.crossings = self.inside = self.nema = 0
        self.places: list[tuple[float, float]] = []
        self.left_hand = False
        self.parser = xml.parsers.expat.ParserCreate()
        self.parser.StartElementHandler = self._element
        self.parser.StartDoctypeDeclHandler = self._doctype

    def feed(self, chunk: bytes, last: bool = False) -> None:
        try:
            self.parser.Parse(chunk, last)
        except xml.parsers.expat.ExpatError as error:
            raise InvalidInputError(f"'{self.file}' is no well-formed XML: {error}") from error

    def census(self) -> Census:
        place = None
        if self.places:
            latitudes, longitudes = zip(*self.places, strict=True)
            place = median(latitudes), median(longitudes)
        lights = self.elements["tlLogic"]
        return Census(
            self.elements, self.sidewalks, self.crossings, lights, place, self.inside, self.nema, self.left_hand
        )

    def _doctype(self, *_: object) -> NoReturn:
        raise InvalidInputError(f"'{self.file}' has a DOCTYPE; road files need none, and entities are not read")

    def _element(self, tag: str, attributes: dict[str, str]) -> None:
        if not self.elements and tag != self.root:
            raise InvalidInputError(f"'{self.file}': expected the root element <{self.root}>, got <{tag[:40]}>")
        self._check_files(tag, attributes)
        self.elements[tag] += 1
        self.sidewalks += tag == "lane" and attributes.get("allow") == "pedestrian"
        self.crossings += tag == "edge" and attributes.get("function") == "crossing"
        self.inside += tag == "edge" and attributes.get("function") == "internal"
        self.nema += tag == "tlLogic" and attributes.get("type") == "NEMA"
        self.left_hand |= tag == "net" and attributes.get("lefthand", "").lower() in _TRUE
        self.left_hand |= tag == "road" and attributes.get("rule") == "LHT"
        if tag == "node" and self.root == "osm" and self.elements["node"] % _EVERY_NODE == 1:
            self._locate(attributes)

    def _locate(self, attributes: dict[str, str]) -> None:
        with suppress(KeyError, ValueError):  # netconvert refuses such nodes, or leaves them out
            place = float(attributes["lat"]), float(attributes["lon"])
            if all(map(math.isfinite, place)):
                self.places.append(place)

    def _check_files(self, tag: str, attributes: dict[str, str]) -> None:
        """Refuses whatever makes SUMO read or write another file."""
        if tag.rpartition(":")[2].lower() == "include":
            raise InvalidInputError(f"'{self.file}' has an element <{tag[:40]}>; expected all roads in one file")
        if self.root != "net":
            return
        if tag not in _NET_ELEMENTS:
            raise InvalidInputError(f"'{self.file}' has an element <{tag[:40]}>; expected only roads and their lights")
        if tag == "param" and attributes.get("key") == "file" and attributes.get("value") != "NUL":
            raise InvalidInputError(f"'{self.file}': a light has a parameter 'file', to which SUMO would write")


def _open(file: Path) -> BinaryIO:
    if file.suffix.lower() == ".bz2":
        return bz2.open(file, "rb")  # type: ignore[return-value]
    return gzip.open(file, "rb") if file.suffix.lower() == ".gz" else file.open("rb")  # type: ignore[return-value]


def _packing(file: Path) -> str:
    return "bzip2" if file.suffix.lower() == ".bz2" else "gzip"


def refuse_size(file: Path, state: str, limit_mb: float) -> NoReturn:
    """Refuses a file that is larger than the limit.

    Args:
        file: Path that the user gave.
        state: " unpacked" if the packed file is small enough, else "".
        limit_mb: The limit, MB.

    Raises:
        InvalidInputError: Always.
    """
    raise InvalidInputError(f"'{file}' is larger{state} than {limit_mb:g} MB; an import may allow more with --limit-mb")
