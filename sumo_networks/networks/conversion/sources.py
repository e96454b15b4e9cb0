"""Sources: road files of every kind, unpacked and checked before netconvert reads them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.xml_guard import Census, check_size, refuse_size, scan

Kind = Literal["net", "osm", "xodr"]

ROOTS: dict[Kind, str] = {"net": "net", "osm": "osm", "xodr": "OpenDRIVE"}
SUFFIXES: dict[str, Kind] = {".net.xml": "net", ".osm": "osm", ".osm.xml": "osm", ".xodr": "xodr"}
PACKED = (".gz", ".bz2")
PBF = ".pbf"
TITLES: dict[Kind, str] = {"net": "a SUMO net", "osm": "OpenStreetMap", "xodr": "OpenDRIVE"}
_WAYS = ("highway", "railway")
_NODE_BYTES, _TAG_BYTES = 13, 16  # of a reference and a tag without its texts, as XML


def kind_of(file: Path) -> Kind:
    """Kind of a road file, by its name.

    Raises:
        InvalidInputError: The name has another ending.
    """
    suffix = file_suffix(str(file))
    return next((SUFFIXES[known] for known in SUFFIXES if suffix.startswith(known)), "osm")


def file_suffix(name: str) -> str:
    """Ending of a road file's name, in small letters and with that of its packing.

    Raises:
        InvalidInputError: The name has another ending.
    """
    endings = [f"{suffix}{packed}" for suffix in SUFFIXES for packed in ("", *PACKED)] + [PBF]
    found = next((ending for ending in endings if name.lower().endswith(ending)), None)
    if found is None:
        raise InvalidInputError(
            f"'{name}': expected a file that ends in {', '.join(SUFFIXES)} (each also with {' or '.join(PACKED)}) or "
            f"{PBF}"
        )
    return found


def unpack(file: Path, limit_mb: float, plain: Path) -> Census:
    """Checks a road file, and writes it as plain XML.

    Args:
        file: Path that the user gave.
        limit_mb: Largest size, packed or unpacked, MB.
        plain: File to write.

    Raises:
        InvalidInputError: The file is missing, too large, broken or harmful, or its reader is not installed.
    """
    root = ROOTS[kind_of(file)]
    if not file.name.lower().endswith(PBF):
        return scan(file, root, limit_mb, copy=plain)
    check_size(file, limit_mb)
    unpacked = plain.with_suffix(".osm")
    _write_roads(file, limit_mb, unpacked)
    unpacked.rename(plain)
    return scan(plain, root, limit_mb)


def _write_roads(file: Path, limit_mb: float, target: Path) -> None:
    """Writes the roads of a .pbf file as OSM XML, with their nodes and turn restrictions."""
    try:
        import osmium
    except ModuleNotFoundError as error:
        raise InvalidInputError(
            f"'{file}': reading {PBF} needs osmium, which is not installed: pip install 'dohyo[pbf]'"
        ) from error
    try:
        with osmium.BackReferenceWriter(str(target), ref_src=str(file), overwrite=True, remove_tags=False) as writer:
            least = 0  # bytes that the ways need at least, since the writer writes at its end
            for way in _ways(osmium, file):
                least += _NODE_BYTES * len(way.nodes) + sum(_TAG_BYTES + len(tag.k) + len(tag.v) for tag in way.tags)
                if least > limit_mb * 1e6:
                    refuse_size(file, " unpacked", limit_mb)
                writer.add(way)
            restrictions = osmium.FileProcessor(str(file), osmium.osm.RELATION)
            for relation in restrictions.with_filter(osmium.filter.TagFilter(("type", "restriction"))):
                writer.add(relation)
    except (RuntimeError, osmium.InvalidLocationError) as error:
        raise InvalidInputError(f"'{file}' is no complete {PBF} file: {error}") from error
    if target.stat().st_size > limit_mb * 1e6:
        refuse_size(file, " unpacked", limit_mb)


def _ways(osmium: Any, file: Path) -> Iterator[Any]:
    yield from osmium.FileProcessor(str(file), osmium.osm.WAY).with_filter(osmium.filter.KeyFilter(*_WAYS))
