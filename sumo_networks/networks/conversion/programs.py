"""Signal programs: what netconvert has changed in the programs of a net's own traffic lights."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from dohyo.sumo_networks.networks.lights import duration_s

_GREEN = "Gg"
_CLOCK = re.compile(r"\d+(:\d+)+(\.\d*)?")  # [days:]hours:minutes:seconds


@dataclass(frozen=True, slots=True)
class SignalProgram:
    """One program of a traffic light.

    Attributes:
        kind: SUMO's type, such as static or actuated.
        offset: s.
        phases: Attributes of each phase.
        parameters: Further parameters.
    """

    kind: str
    offset: str
    phases: tuple[Mapping[str, str], ...]
    parameters: Mapping[str, str]

    @property
    def cycle_s(self) -> float:
        """Sum of the phases' durations, s."""
        return sum(duration_s(phase.get("duration", "0")) for phase in self.phases)

    @property
    def links(self) -> int:
        """Number of links that the program controls."""
        return max((len(phase.get("state", "")) for phase in self.phases), default=0)

    def values(self, attribute: str) -> list[str]:
        """Values of one attribute in those phases that have it, sorted."""
        return sorted(phase[attribute] for phase in self.phases if attribute in phase)

    def shortest_green_s(self, link: int) -> float:
        """Least time for which a link stays green, s; infinite if it always is, or never."""
        greens = [phase.get("state", "")[link : link + 1] in tuple(_GREEN) for phase in self.phases]
        least = [duration_s(phase.get("minDur", phase.get("duration", "0"))) for phase in self.phases]
        if all(greens) or not any(greens):
            return float("inf")
        first = greens.index(False)
        runs, before = list[float](), False
        for row in (*range(first, len(greens)), *range(first)):
            if greens[row]:
                runs = [*runs[:-1], runs[-1] + least[row]] if before else [*runs, least[row]]
            before = greens[row]
        return min(runs)


Programs = dict[tuple[str, str], SignalProgram]
"""Programs by the ids of their light and of the program."""


def read_programs(net: Path) -> Programs:
    """Reads the signal programs of a net that `xml_guard.scan` has accepted."""
    found: Programs = {}
    for _, element in ElementTree.iterparse(net):
        if element.tag == "tlLogic":
            found[element.get("id", ""), element.get("programID", "")] = SignalProgram(
                kind=element.get("type", ""),
                offset=_plain(element.get("offset", "0")),
                phases=tuple({key: _plain(value) for key, value in one.items()} for one in element.iter("phase")),
                parameters={one.get("key", ""): _plain(one.get("value", "")) for one in element.iter("param")},
            )
        if element.tag in ("tlLogic", "edge", "junction", "connection"):
            element.clear()
    return found


def _plain(value: str) -> str:
    """An attribute's value; a number in one spelling, such as 3 for 3.00 and for 0:0:3."""
    if _CLOCK.fullmatch(value):
        return f"{duration_s(value):g}"
    with suppress(ValueError):
        return f"{float(value):g}"
    return value


def describe_changes(before: Programs, after: Programs) -> list[str]:
    """Lines about the programs that a conversion has changed or lost, for people."""
    gone = before.keys() - after.keys()
    changed = [(before[key], after[key]) for key in sorted(before.keys() & after.keys()) if before[key] != after[key]]
    lines = []
    if changed:
        counts = ((what, sum(holds(*pair) for pair in changed)) for what, holds in _CHANGES)
        how = ", ".join(f"{count} {what}" for what, count in counts if count)
        lines.append(f"{len(changed)} of {len(before)} signal programs of the file are changed: {how}")
    if gone:
        lines.append(f"{len(gone)} of {len(before)} signal programs of the file are left out")
    return lines


def _has_longer_green(before: SignalProgram, after: SignalProgram) -> bool:
    links = range(min(before.links, after.links))
    return any(after.shortest_green_s(link) > before.shortest_green_s(link) for link in links)


def _is_other(before: SignalProgram, after: SignalProgram) -> bool:
    """Whether a change is none of those that have a name."""
    return not any(holds(before, after) for _, holds in _CHANGES[:-1])


_Holds = Callable[[SignalProgram, SignalProgram], bool]
_CHANGES: tuple[tuple[str, _Holds], ...] = (
    ("with signals for crossings", lambda before, after: after.links > before.links),
    ("with more phases", lambda before, after: len(after.phases) > len(before.phases)),
    ("with a longer cycle", lambda before, after: after.cycle_s > before.cycle_s),
    ("with a longer shortest green", _has_longer_green),
    ("with another order of phases ('next')", lambda before, after: after.values("next") != before.values("next")),
    ("without the names of phases", lambda before, after: after.values("name") != before.values("name")),
    ("of another type", lambda before, after: after.kind != before.kind),
    ("changed otherwise", _is_other),
)
