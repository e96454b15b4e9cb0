"""Source files: what a road file says, what is decided about it, and the net that netconvert makes of it."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.conversion.countries import (
    Country,
    country_at,
    country_named,
    unknown_country,
)
from dohyo.sumo_networks.networks.conversion.mirroring import mirror_image
from dohyo.sumo_networks.networks.conversion.netconvert import TIMEOUT_S, Conversion, convert
from dohyo.sumo_networks.networks.conversion.programs import describe_changes, read_programs
from dohyo.sumo_networks.networks.conversion.sources import Kind, kind_of, unpack
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.networks.xml_guard import LIMIT_MB, Census

MIRRORED = (
    "left-hand traffic: this network is the mirror image of the place, in which traffic drives on the right; east and "
    "west, and left and right turns, change places"
)


@dataclass(frozen=True, slots=True)
class ImportOptions:
    """Choices of an import.

    Attributes:
        lights: Whether to guess traffic lights at large junctions too.
        left_hand: Whether traffic drives on the left; None: as in the country of an OSM extract, or as the file says.
        country: Two letters of the country whose rules hold in an OSM extract; None: that of the nearest town.
        largest_part: Whether to remove the roads that do not lead to and from the largest connected part.
        fix: Whether to mend lights without a purpose, lights with endless phases, and implausible speed limits.
        mirrored: Whether a net is the mirror image of a place with left-hand traffic already.
        limit_mb: Largest size of the file, packed or unpacked, MB.
        licence: Licence of the source's data; None: the usual one of its format.
        timeout_s: Time limit of netconvert, s.
    """

    lights: bool = False
    left_hand: bool | None = None
    country: str | None = None
    largest_part: bool = False
    fix: bool = False
    mirrored: bool = False
    limit_mb: float = LIMIT_MB
    licence: str | None = None
    timeout_s: float = TIMEOUT_S


USUAL_OPTIONS = ImportOptions()


@dataclass(frozen=True, slots=True)
class ConvertedNet:
    """A converted net.

    Attributes:
        path: The net, with right-hand traffic.
        warnings: netconvert's warnings; None: the net is the file as it is.
        decided: Decisions, one line each.
    """

    path: Path
    warnings: Sequence[str] | None
    decided: Sequence[str]


@dataclass(frozen=True, slots=True)
class SourceFile:
    """A road file that was checked and unpacked.

    Attributes:
        file: Path that the user gave.
        kind: Its kind.
        plain: Its plain XML.
        census: Its content.
        options: Choices of the import.
        country: Country whose limits hold where a road has none; None: the file's roads have limits.
        left_hand: Whether its traffic drives on the left.
    """

    file: Path
    kind: Kind
    plain: Path
    census: Census
    options: ImportOptions
    country: Country | None
    left_hand: bool

    def convert(self, built: Path) -> ConvertedNet:
        """Makes a net with right-hand traffic; the mirror image, if the file's traffic drives on the left.

        Args:
            built: File to write.

        Raises:
            InvalidInputError: netconvert cannot use the file.
        """
        decided = [f"country {self.country.code}: {self.country.summary}"] if self.country else []
        if self.left_hand or self.options.mirrored:
            decided.append(MIRRORED)
        mirrored_first = self.left_hand and self.kind == "net"
        if mirrored_first:
            self._mirror()
        if self.kind == "net" and self.census.crossings > 0 and not self.options.lights:
            return ConvertedNet(self.plain, None, decided)
        if self.census.nema:
            decided.append(f"no crossings are guessed, since they would break {self.census.nema} NEMA signal programs")
        settings = Conversion(
            kind=self.kind,
            source=self.plain,
            file=self.file,
            lights=self.options.lights,
            crossings=not self.census.nema,
            drop_lights=self.options.fix,
            left_hand=self.left_hand and not mirrored_first,
            country=self.country,
            timeout_s=self.options.timeout_s,
        )
        warnings, chosen = convert(settings, built)
        if settings.left_hand:
            built.write_bytes(mirror_image(built.read_bytes()))
        if self.kind == "net" and self.census.lights:
            chosen += describe_changes(read_programs(self.plain), read_programs(built))
        return ConvertedNet(built, warnings, [*decided, *chosen])

    def _mirror(self) -> None:
        try:
            self.plain.write_bytes(mirror_image(self.plain.read_bytes()))
        except ValueError as error:
            raise InvalidInputError(f"'{self.file}': its left-hand traffic cannot be mirrored: {error}") from error

    def counted(self, network: RoadNetwork, warnings: Sequence[str] | None) -> tuple[str, ...]:
        """Lines about what was guessed: numbers of objects, and netconvert's warnings."""
        if warnings is None:
            return ()
        before, lanes = self.census, network.lanes
        sidewalks = lanes.pedestrian & ~lanes.drivable & ~lanes.bicycle & ~lanes.crossing
        sidewalks &= [not str(lane).startswith(":") for lane in lanes.ids]
        counts = [
            ("sidewalks", int(sidewalks.sum()) - before.sidewalks),
            ("crossings", int(lanes.crossing.sum()) - before.crossings),
            ("traffic lights", len(network.signals.light_ids) - before.lights),
        ]
        if self.kind == "net" and not before.inside:
            counts.append(("lanes inside junctions", int((lanes.internal & lanes.drivable).sum())))
        how = "added" if self.kind == "net" else "read or guessed"
        kinds = Counter(re.sub(r"'[^']*'|-?\d+(\.\d+)?", "…", warning) for warning in warnings)
        return (
            *(f"{count} {what} {how}" for what, count in counts if count > 0),
            *(f"netconvert, {count} x: {text}" for text, count in kinds.most_common(12)),
        )


def read_source(file: Path, plain: Path, options: ImportOptions) -> SourceFile:
    """Checks a road file, unpacks it, and decides on its country and the side of its traffic.

    Args:
        file: Path that the user gave.
        plain: File to write the plain XML to.
        options: Choices of the import.

    Raises:
        InvalidInputError: The file cannot be imported.
    """
    kind = kind_of(file)
    census = unpack(file, options.limit_mb, plain)
    if kind == "net" and not census.elements["lane"]:
        raise InvalidInputError(f"'{file}' has no lane open to passenger cars: it has no lane at all")
    country = _country(file, kind, census, options)
    left_hand = _left_hand(file, kind, census, options, country)
    return SourceFile(file, kind, plain, census, options, country, left_hand)


def _country(file: Path, kind: Kind, census: Census, options: ImportOptions) -> Country | None:
    """Country of an OSM extract; None for other kinds of files, whose roads have limits."""
    if kind != "osm":
        if options.country is not None:
            raise InvalidInputError(f"'{file}': a country can be given for OpenStreetMap files only")
        return None
    if options.country is not None:
        return country_named(options.country)
    return country_at(*census.place) if census.place else unknown_country()


def _left_hand(file: Path, kind: Kind, census: Census, options: ImportOptions, country: Country | None) -> bool:
    asked = options.left_hand
    if country is not None:
        return country.left_hand if asked is None else asked
    if kind == "xodr" and (asked or census.left_hand):
        raise InvalidInputError(
            f"'{file}': left-hand traffic cannot be imported from OpenDRIVE, which netconvert reads as right-hand "
            "traffic"
        )
    if asked is not None and asked != census.left_hand:
        side = "left" if census.left_hand else "right"
        raise InvalidInputError(f"'{file}': the net says that traffic drives on the {side}")
    return census.left_hand
