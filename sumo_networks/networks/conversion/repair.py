"""Repair: removes roads that lead nowhere, and mends lights and limits that disturb drivers."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from dohyo.sumo_networks.networks.connectivity import largest_part
from dohyo.sumo_networks.networks.conversion.netconvert import rebuild
from dohyo.sumo_networks.networks.faults import FaultKind, find_faults, usual_limit
from dohyo.sumo_networks.networks.lights import junctions_of, roads_into
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.units import KMH_PER_MPS

_PROGRAM = re.compile(rb'[ ]*<tlLogic id="(?P<light>[^"]*)".*?</tlLogic>\n', re.DOTALL)
_CONNECTION = re.compile(rb"<connection [^>]*>")
_ATTRIBUTE = re.compile(rb'(\w+)="([^"]*)"')


@dataclass(slots=True)
class Repair:
    """Changes of a net, in the order in which they are carried out.

    Attributes:
        decided: The changes for people, one line each.
        removed: SUMO ids of the edges to remove.
        limits: New speed limit by edge, m/s.
        unlit: SUMO ids of the junctions that lose their light.
        endless: SUMO ids of the lights that get a usual program.
    """

    decided: list[str] = field(default_factory=list)
    removed: Sequence[str] = ()
    limits: dict[str, float] = field(default_factory=dict)
    unlit: list[str] = field(default_factory=list)
    endless: list[str] = field(default_factory=list)

    @property
    def needed(self) -> bool:
        """Whether there is anything to change."""
        return bool(self.decided)

    def carry_out(self, net: Path, target: Path, file: Path, timeout_s: float) -> Path:
        """Makes the changed net; returns its path.

        Args:
            net: The net to change.
            target: The net to write.
            file: Path that the user gave, for error messages.
            timeout_s: Time limit of netconvert, s.

        Raises:
            InvalidInputError: netconvert fails or takes too long.
        """
        options = []
        if self.removed:
            options += ["--remove-edges.input-file", str(_lines(self.removed, target.with_name("removed.txt")))]
        if self.limits:
            options += ["-e", str(_limits(self.limits, target.with_name("limits.edg.xml")))]
        if self.unlit:
            options += ["-n", str(_unlit(self.unlit, target.with_name("unlit.nod.xml")))]
        rebuild(net, target, file, options, timeout_s)
        if self.endless:
            usual = target.with_name("usual.net.xml")
            rebuild(target, usual, file, ["--tls.rebuild", "--tls.default-type", "static"], timeout_s)
            target.write_bytes(_keep_programs(usual.read_bytes(), target.read_bytes(), set(self.endless)))
        return target


def plan_repair(network: RoadNetwork, *, largest: bool, fix: bool) -> Repair:
    """Finds what is to be changed.

    Args:
        network: The roads.
        largest: Whether to keep only the roads that cars in the largest connected part can reach and leave.
        fix: Whether to mend lights and limits.
    """
    repair = Repair()
    if largest:
        _remove_others(network, repair)
    if fix:
        _mend_lights(network, repair)
        _mend_limits(network, repair)
    return repair


def _remove_others(network: RoadNetwork, repair: Repair) -> None:
    lanes = network.lanes
    road = lanes.drivable & ~lanes.internal
    inside = largest_part(network) & road
    others = np.setdiff1d(lanes.edge[road], lanes.edge[inside])
    if len(others):
        gone = float(lanes.length[road & np.isin(lanes.edge, others)].sum()) / 1000
        repair.removed = [str(lanes.edge_ids[edge]) for edge in others]
        repair.decided.append(f"{gone:.1f} km of lanes outside the largest connected part are removed")


def _mend_lights(network: RoadNetwork, repair: Repair) -> None:
    removed = set(repair.removed)
    faults = [fault for fault in find_faults(network) if fault.kind in (FaultKind.LIGHT_AT_BEND, FaultKind.LONG_PHASE)]
    faults = [fault for fault in faults if not roads_into(network, fault.name) <= removed]
    bends = [fault.name for fault in faults if fault.kind is FaultKind.LIGHT_AT_BEND and not fault.value]
    repair.endless = [fault.name for fault in faults if fault.kind is FaultKind.LONG_PHASE]
    repair.unlit = [junction for light in bends for junction in junctions_of(network, light)]
    if bends:
        repair.decided.append(f"{len(bends)} lights at bends without crossings are removed: {', '.join(bends)}")
    if repair.endless:
        names = ", ".join(repair.endless)
        repair.decided.append(f"{len(repair.endless)} lights with endless phases get usual programs: {names}")


def _keep_programs(net: bytes, before: bytes, others: set[str]) -> bytes:
    """A net in which lights have the programs of the net before, where they still control the same links.

    Args:
        net: The net with new programs.
        before: The net with the programs to keep.
        others: Lights whose programs are not kept.
    """
    links, old_links = _links(net), _links(before)
    kept: dict[bytes, list[bytes]] = {}
    for match in _PROGRAM.finditer(before):
        light = match["light"]
        if light.decode() not in others and links.get(light) == old_links.get(light):
            kept.setdefault(light, []).append(match[0])

    def replaced(match: re.Match[bytes]) -> bytes:
        if match["light"] not in kept:
            return match[0]
        programs, kept[match["light"]] = kept[match["light"]], []  # all at the place of the first
        return b"".join(programs)

    return _PROGRAM.sub(replaced, net)


def _links(net: bytes) -> dict[bytes, set[tuple[bytes, ...]]]:
    """Links that each light controls: from, to, lanes and index."""
    found: dict[bytes, set[tuple[bytes, ...]]] = {}
    for connection in _CONNECTION.findall(net):
        attributes = dict(_ATTRIBUTE.findall(connection))
        if b"tl" in attributes:
            link = tuple(attributes[key] for key in (b"from", b"to", b"fromLane", b"toLane", b"linkIndex"))
            found.setdefault(attributes[b"tl"], set()).add(link)
    return found


def _mend_limits(network: RoadNetwork, repair: Repair) -> None:
    found = (fault.name for fault in find_faults(network) if fault.kind is FaultKind.LIMIT)
    wrong = [edge for edge in found if edge not in repair.removed]
    if wrong:
        usual = usual_limit(network)
        repair.limits = dict.fromkeys(wrong, usual)
        repair.decided.append(f"implausible limits of {len(wrong)} roads become {usual * KMH_PER_MPS:.0f} km/h")


def _lines(names: Iterable[str], file: Path) -> Path:
    file.write_text("\n".join(names), encoding="utf-8")
    return file


def _unlit(junctions: Iterable[str], file: Path) -> Path:
    rows = (f'<node id={quoteattr(junction)} type="priority"/>' for junction in junctions)
    file.write_text(f"<nodes>{''.join(rows)}</nodes>", encoding="utf-8")
    return file


def _limits(limits: dict[str, float], file: Path) -> Path:
    rows = (f'<edge id={quoteattr(edge)} speed="{speed:.2f}"/>' for edge, speed in limits.items())
    file.write_text(f"<edges>{''.join(rows)}</edges>", encoding="utf-8")
    return file
