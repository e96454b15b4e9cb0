"""One day of segment speeds: a simulation of the freeway from its demand, measured minute by minute.

Most days are simulated as queues (meso); days with stop-and-go waves as single vehicles (micro). Both use the same
routes, and in both SUMO itself measures edge by edge, so that Python reads no single vehicle.
"""

from __future__ import annotations

import math
import shutil
import tempfile
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

import libsumo
import numpy as np

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.errors import InvalidInputError, SimulationError
from dohyo.sumo_networks.freeway.apart import Progress, drive_apart
from dohyo.sumo_networks.freeway.demand import check_incidents, check_places, draw_demand, write_routes
from dohyo.sumo_networks.freeway.drivers import KINDS, PROBE
from dohyo.sumo_networks.freeway.measure import MINUTE_S
from dohyo.sumo_networks.freeway.process import MESO, MICRO, start_sumo
from dohyo.sumo_networks.freeway.road import FreewayRoad, load_freeway
from dohyo.sumo_networks.freeway.scenario import FreewayScenario, Incident

Scale = Literal["meso", "micro"]
CRAWL_MPS = 5.5
"""Speed past an incident in meso, where no vehicle can block a lane, m/s: about 75 % of the flow passes.

An incident acts in whole minutes, from up to a minute before its time. An edge with an incident on a day may have other
traffic all day: SUMO computes exit times anew whenever its speed is set, each minute. To set it at changes alone would
make the days of the benchmarks others.
"""

MESO_JAM_FACTOR = 0.55
"""Factor on standing gaps in meso: with this value queues have stop-and-go waves; with more they are uniform."""


@dataclass(frozen=True, eq=False)
class Measured:
    """SUMO's measurements of one group of vehicles, T minutes and S segments.

    Attributes:
        speed_mps: (T, S) space-mean speed; NaN without a vehicle of the group.
        seconds: (T, S) time that the group spent in the segment, summed over vehicles, s.
        left: (T, S) number of vehicles that left the segment downstream or by its ramp.
    """

    speed_mps: FloatArray
    seconds: FloatArray
    left: FloatArray


@dataclass(frozen=True, eq=False)
class SpeedDay:
    """Measurements of T minutes of a day.

    Attributes:
        minute: (T,) minutes since midnight.
        truth: Measurements of all vehicles.
        probes: Measurements of the probes, the vehicles whose speed is reported.
    """

    minute: FloatArray
    truth: Measured
    probes: Measured


def drive_day(
    scenario: FreewayScenario, scale: Scale, progress: Progress = lambda _share: None, *, drawn: bool = False
) -> SpeedDay:
    """Simulates a scenario and measures it.

    Args:
        scenario: Scenario to simulate.
        scale: `meso` for queues, in a process of its own; `micro` for single vehicles, in this one.
        progress: Function that receives the share done, 0 to 1.
        drawn: Whether the day was drawn: incidents too soon after the beginning of the warm-up are then left out.

    Raises:
        InvalidInputError: The duration is no whole number of minutes; or an incident lies off the road, or too soon
            after the beginning of the warm-up (`micro`).
        SimulationError: SUMO failed, or another simulation of this process is open (`micro`).
    """
    minutes = scenario.duration_s / MINUTE_S
    if not math.isclose(minutes, max(round(minutes), 1)):  # 1.1 h is a little more than 66 minutes
        raise InvalidInputError(f"a measured day: expected a duration of whole minutes, got {scenario.duration_s:g} s")
    if scale == "micro" and not drawn:
        check_incidents(load_freeway(scenario.network), scenario)
    with tempfile.TemporaryDirectory(prefix="dohyo-day-") as folder:
        drive = partial(_drive_and_measure, scenario, scale, Path(folder))
        return drive(progress) if scale == "micro" else drive_apart(drive, progress)


def _drive_and_measure(scenario: FreewayScenario, scale: Scale, folder: Path, progress: Progress) -> SpeedDay:
    """Drives a day with files in a folder, which it removes: the process that made it may have been killed."""
    try:
        return _measured(scenario, scale, folder, progress)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _measured(scenario: FreewayScenario, scale: Scale, folder: Path, progress: Progress) -> SpeedDay:
    road = load_freeway(scenario.network)
    check_places(road, scenario.day.incidents)
    begin = max(scenario.start_s - scenario.warm_up_s, 0.0)
    minutes = round(scenario.duration_s / MINUTE_S)
    demand = draw_demand(road, scenario)
    seed = int(np.random.SeedSequence(scenario.seed).spawn(6)[5].generate_state(1)[0] % 2**31)
    routes, detectors = folder / "day.rou.xml", folder / "day.add.xml"
    if scale == "meso":
        calm = scenario.model_copy(update={"day": scenario.day.model_copy(update={"incidents": ()})})
        write_routes(road, calm, demand, routes, MESO_JAM_FACTOR)
    else:
        write_routes(road, scenario, demand, routes)
    detectors.write_text(_detectors(scenario, folder), encoding="utf-8")
    start_sumo(road.network.path, [routes, detectors], begin, seed, MESO if scale == "meso" else MICRO)
    try:
        _drive(road, scenario, scale, begin, progress)
    finally:
        libsumo.close()
    truth, probes = (_read(road, folder / f"{group}.xml", scenario.start_s, minutes) for group in _GROUPS)
    return SpeedDay(scenario.start_s / MINUTE_S + np.arange(minutes, dtype=np.float64), truth, probes)


_GROUPS = ("truth", "probes")


def _detectors(scenario: FreewayScenario, folder: Path) -> str:
    probes = f'vTypes="{" ".join(kind + PROBE for kind in KINDS)}"'
    common = (
        f'period="{MINUTE_S:g}" begin="{scenario.start_s:g}" end="{scenario.start_s + scenario.duration_s:g}" '
        'excludeEmpty="true" writeAttributes="speed sampledSeconds left"'
    )
    lines = [
        f'<edgeData id="{group}" file="{folder / group}.xml" {common} {probes if group == "probes" else ""}/>'
        for group in _GROUPS
    ]
    return "<additional>\n" + "\n".join(lines) + "\n</additional>\n"


def _drive(road: FreewayRoad, scenario: FreewayScenario, scale: Scale, begin_s: float, progress: Progress) -> None:
    end = scenario.start_s + scenario.duration_s
    usual = {edge: libsumo.lane.getMaxSpeed(f"{edge}_0") for edge in road.mainline.edges}
    for time_s in np.arange(begin_s + MINUTE_S, end + MINUTE_S + 1, MINUTE_S):
        try:
            if scale == "meso":
                _slow_down(road, scenario.day.incidents, usual, float(time_s))
            libsumo.simulationStep(float(time_s))
        except (libsumo.TraCIException, libsumo.FatalTraCIError) as error:
            minute = f"from {time_s - MINUTE_S:.0f} to {time_s:.0f} s since midnight"
            raise SimulationError(f"SUMO failed in the minute {minute}: {error}") from error
        progress(min((time_s - begin_s) / (end - begin_s), 1.0))


def _slow_down(road: FreewayRoad, incidents: Sequence[Incident], usual: Mapping[str, float], time_s: float) -> None:
    """Slows the edges that have at least one incident in force, and frees the edges whose incidents are all over."""
    crawling: dict[str, bool] = {}
    for incident in incidents:
        edge, _ = road.edge_at(incident.position_m)
        in_force = incident.time_s <= time_s < incident.time_s + incident.duration_s
        crawling[edge] = crawling.get(edge, False) or in_force
    for edge, crawls in crawling.items():
        libsumo.edge.setMaxSpeed(edge, CRAWL_MPS if crawls else usual[edge])


def _read(road: FreewayRoad, file: Path, start_s: float, minutes: int) -> Measured:
    segment_of = {edge: row for row, segment in enumerate(road.mainline.segments) for edge in segment}
    last = {segment[-1]: row for row, segment in enumerate(road.mainline.segments)}
    metres, seconds, left = np.zeros((3, minutes, road.segments))
    try:
        for _, interval in ElementTree.iterparse(file, events=("end",)):
            if interval.tag != "interval":
                continue
            minute = round((float(interval.attrib["begin"]) - start_s) / MINUTE_S)
            for edge in interval if 0 <= minute < minutes else ():
                segment = segment_of.get(edge.attrib["id"])
                if segment is None:
                    continue
                spent = float(edge.attrib["sampledSeconds"])
                seconds[minute, segment] += spent
                metres[minute, segment] += spent * float(edge.attrib.get("speed", 0.0))
                if edge.attrib["id"] in last:
                    left[minute, segment] += float(edge.attrib["left"])
            interval.clear()
    except (OSError, ElementTree.ParseError) as error:
        raise SimulationError(f"SUMO's measurements '{file.name}' cannot be read: {error}") from error
    speed = np.divide(metres, seconds, out=np.full_like(metres, np.nan), where=seconds > 0)
    return Measured(speed, seconds, left)
