"""Demand: departures, origins and destinations, drawn from the scenario's seed and written as a SUMO route file."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from dohyo.sumo_networks.arrays import BoolArray, FloatArray, IntArray
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.freeway.drivers import CAR, CONNECTED, KINDS, PROBE, TRUCK, vehicle_types
from dohyo.sumo_networks.freeway.road import FreewayRoad
from dohyo.sumo_networks.freeway.scenario import WEEKEND, Day, FreewayScenario, Incident
from dohyo.sumo_networks.portable_math import exp

SLICE_S = 60.0
APPROACH_MPS = 28.0
"""Assumed speed of a car on its way to the place of its breakdown, m/s.

In free flow cars are faster and stop up to a minute before the expected time; behind a queue, minutes after it.
"""

NIGHT = 0.10
"""Smallest demand, as a share of the peak's."""


@dataclass(frozen=True, slots=True)
class Bell:
    """A bell-shaped part of the day's demand.

    Attributes:
        height: Height as a share of an ordinary morning's peak.
        centre_h: Time of the maximum, hours since midnight.
        rise_h: Standard deviation before the maximum, hours.
        fall_h: Standard deviation after the maximum, hours.
    """

    height: float
    centre_h: float
    rise_h: float
    fall_h: float

    def at(self, hour: FloatArray) -> FloatArray:
        """Demand of this part at hours of the day."""
        width = np.where(hour < self.centre_h, self.rise_h, self.fall_h)
        return np.asarray(self.height * exp(-0.5 * ((hour - self.centre_h) / width) ** 2))


MORNING = Bell(0.79, 7.15, 0.95, 1.1)
WEEKDAY = (Bell(0.22, 10.0, 2.6, 3.0), Bell(0.42, 15.8, 3.2, 2.6), Bell(0.10, 20.0, 2.5, 2.0))
WEEKEND_DAY = (Bell(0.52, 13.5, 4.2, 4.0), Bell(0.12, 18.0, 2.5, 3.0))


@dataclass(frozen=True, eq=False)
class Demand:
    """Journeys of V vehicles in the order of their departure.

    Attributes:
        time_s: (V,) time of departure, s since midnight.
        entry: (V,) 0 the approach, k the k-th on-ramp.
        exit: (V,) 0 the departure, k the k-th off-ramp.
        kind: (V,) row in `KINDS`.
        probe: (V,) whether the vehicle reports its speed.
    """

    time_s: FloatArray
    entry: IntArray
    exit: IntArray
    kind: IntArray
    probe: BoolArray


def share_of_peak(day: Day, time_s: FloatArray) -> FloatArray:
    """Demand at times of a day as a share of an ordinary morning's peak, without the day's own factor."""
    hour = np.asarray(time_s) / 3600
    if day.weekday in WEEKEND:
        return NIGHT + sum((bell.at(hour) for bell in WEEKEND_DAY), np.zeros_like(hour))
    morning = replace(
        MORNING,
        centre_h=MORNING.centre_h + day.peak_shift_s / 3600,
        rise_h=MORNING.rise_h * day.peak_width,
        fall_h=MORNING.fall_h * day.peak_width,
    )
    return NIGHT + sum((bell.at(hour) for bell in WEEKDAY), morning.at(hour))


def draw_demand(road: FreewayRoad, scenario: FreewayScenario) -> Demand:
    """Draws the scenario's vehicles; departure times do not depend on the penetration and the share of probes."""
    times, ways, trucks, links, probes = (
        np.random.default_rng(child) for child in np.random.SeedSequence(scenario.seed).spawn(6)[:5]
    )
    begin, end = scenario.start_s - scenario.warm_up_s, scenario.start_s + scenario.duration_s
    slices = np.arange(max(begin, 0.0), end, SLICE_S)
    level = scenario.day.demand * share_of_peak(scenario.day, slices + SLICE_S / 2)
    came, entries = [], []
    peaks = (road.mainline.peak_vph, *(ramp.peak_vph for ramp in road.mainline.on_ramps.values()))
    for place, peak_vph in enumerate(peaks):
        number = times.poisson(level * peak_vph * SLICE_S / 3600)
        came.append(np.repeat(slices, number) + times.random(int(number.sum())) * SLICE_S)
        entries.append(np.full(len(came[-1]), place, dtype=np.int64))
    time_s, entry = np.concatenate(came), np.concatenate(entries)
    order = np.argsort(time_s, kind="stable")
    order = order[time_s[order] < end]
    time_s, entry = np.round(time_s[order], 2), entry[order]
    cars = trucks.random(len(order)) >= scenario.day.trucks
    linked = links.random(len(order)) < scenario.penetration
    kind = np.where(cars, np.where(linked, KINDS.index(CONNECTED), KINDS.index(CAR)), KINDS.index(TRUCK))
    return Demand(time_s, entry, _exits(road, entry, ways), kind, probes.random(len(order)) < scenario.probes)


def _exits(road: FreewayRoad, entry: IntArray, rng: np.random.Generator) -> IntArray:
    """Draws the exits: a vehicle takes each off-ramp after its entry with the probability of the ramp's share."""
    taken = np.zeros(len(entry), dtype=np.int64)
    for place, ramp in enumerate(road.mainline.off_ramps.values(), start=1):
        leaves = (rng.random(len(entry)) < ramp.share) & (taken == 0) & _ahead(road)[entry, place - 1]
        taken[leaves] = place
    return taken


def _ahead(road: FreewayRoad) -> BoolArray:
    """(entries, off-ramps) whether the off-ramp lies downstream of the entry."""
    return np.asarray(road.joins_m[:, None] < road.leaves_m[None, 1:])


def write_routes(
    road: FreewayRoad, scenario: FreewayScenario, demand: Demand, path: Path, jam_factor: float = 1.0
) -> None:
    """Writes SUMO's route file: types, routes, and one vehicle `v0`, `v1`, ... per row of the demand.

    An incident has a car `wreck0`, `wreck1`, ... that breaks down. It is left out where the car would have to depart
    before the simulation begins; `check_incidents` refuses this for incidents of the simulated time.

    Raises:
        InvalidInputError: An incident lies beyond the segments, or on a lane that does not exist.
    """
    ways = sorted({*zip(demand.entry.tolist(), demand.exit.tolist(), strict=True)})
    with path.open("w", encoding="utf-8") as file:
        file.write("<routes>\n")
        file.writelines(f"{line}\n" for line in vehicle_types(scenario.day.tau_factor, jam_factor))
        file.writelines(f'<route id="{a}-{b}" edges="{" ".join(road.way(a, b))}"/>\n' for a, b in ways)
        begin = max(scenario.start_s - scenario.warm_up_s, 0.0)
        wrecks = [_Wreck.of(road, number, one, begin) for number, one in enumerate(scenario.day.incidents)]
        rows = [*_vehicles(demand), *((wreck.departs_s, wreck.line) for wreck in wrecks if wreck is not None)]
        file.writelines(line for _, line in sorted(rows, key=lambda row: row[0]))
        file.write("</routes>\n")


def _vehicles(demand: Demand) -> Iterator[tuple[float, str]]:
    kinds = [kind + suffix for suffix in ("", PROBE) for kind in KINDS]
    kind = demand.kind + len(KINDS) * demand.probe
    columns = (demand.time_s.tolist(), demand.entry.tolist(), demand.exit.tolist(), kind.tolist())
    for row, (time_s, entry, exit, type_) in enumerate(zip(*columns, strict=True)):
        yield (
            time_s,
            f'<vehicle id="v{row}" type="{kinds[type_]}" route="{entry}-{exit}" depart="{time_s:.2f}" '
            'departLane="best" departSpeed="last"/>\n',
        )


@dataclass(frozen=True, slots=True)
class _Wreck:
    """A car that departs in time to break down at the place of an incident."""

    departs_s: float
    line: str

    @classmethod
    def of(cls, road: FreewayRoad, number: int, incident: Incident, begin_s: float) -> _Wreck | None:
        lane, along = lane_at(road, incident)
        departs = incident.time_s - _approach_s(road, incident)
        if departs < begin_s:
            return None
        way = " ".join(road.way(0, 0))
        stop = f'<stop lane="{lane}" endPos="{along:.1f}" duration="{incident.duration_s:.0f}"/>'
        head = f'<vehicle id="wreck{number}" type="{CAR}" depart="{departs:.2f}" departLane="best" departSpeed="last">'
        return cls(departs, f'{head}<route edges="{way}"/>{stop}</vehicle>\n')


def _approach_s(road: FreewayRoad, incident: Incident) -> float:
    """Time from a car's departure to its breakdown, s."""
    return (incident.position_m - road.start_m) / APPROACH_MPS


def check_incidents(road: FreewayRoad, scenario: FreewayScenario) -> None:
    """Checks that every incident after the beginning of the simulation happens: its car must reach the place in time.

    Raises:
        InvalidInputError: An incident lies beyond the segments, on a lane that does not exist, or too soon after the
            beginning; the message then says which warm-up is needed.
    """
    begin = max(scenario.start_s - scenario.warm_up_s, 0.0)
    check_places(road, scenario.day.incidents)
    for incident in scenario.day.incidents:
        approach = _approach_s(road, incident)
        departs = incident.time_s - approach
        if not departs < begin <= incident.time_s:
            continue
        expected = f"a warm-up of at least {math.ceil(scenario.start_s - departs)} s, got {scenario.warm_up_s:g} s"
        if departs < 0:
            expected = f"a time of at least {math.ceil(approach)} s since midnight, got {incident.time_s:g} s"
        raise InvalidInputError(
            f"incident at {incident.position_m:g} m: its car needs {approach:.0f} s to its place; expected {expected}"
        )


def check_places(road: FreewayRoad, incidents: Iterable[Incident]) -> None:
    """Checks that every incident has a lane.

    Raises:
        InvalidInputError: An incident lies beyond the segments, or on a lane that does not exist.
    """
    for incident in incidents:
        lane_at(road, incident)


def lane_at(road: FreewayRoad, incident: Incident) -> tuple[str, float]:
    """SUMO id of the lane that an incident blocks, and the position along the lane, m.

    Behind the lane's end, inside a junction, it is the end.

    Raises:
        InvalidInputError: The incident lies beyond the segments, or on a lane that does not exist.
    """
    if not road.bounds_m[0] <= incident.position_m < road.bounds_m[-1]:
        raise InvalidInputError(
            f"incident at {incident.position_m:g} m: expected a position in [0, {road.bounds_m[-1]:.0f}) m"
        )
    edge, along = road.edge_at(incident.position_m)
    lanes = {track.lane: lane for lane, track in road.tracks.items() if lane.rsplit("_", 1)[0] == edge}
    if incident.lane not in lanes:
        raise InvalidInputError(
            f"incident at {incident.position_m:g} m: expected a lane from 0 to {max(lanes)}, got {incident.lane}"
        )
    lane = lanes[incident.lane]
    length = float(road.network.lanes.length[road.network.lane_index[lane]])
    end = math.floor(10.0 * length + 1e-6) / 10.0  # SUMO takes no place beyond the lane, and routes have tenths
    return lane, min(max(along, 10.0), end)
