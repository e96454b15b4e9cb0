"""One day of segment speeds: the freeway is driven from its demand, and measured minute by minute.

Queues (meso) are what bulk days are made of; single vehicles (micro) where waves matter. Both are driven from the same
routes, and both are measured by SUMO itself, edge by edge, so that no vehicle passes through Python.
"""

from __future__ import annotations

import tempfile
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

import libsumo
import numpy as np

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.errors import SimulationError
from dohyo.sumo_networks.freeway.apart import Progress, drive_apart
from dohyo.sumo_networks.freeway.demand import draw_demand, write_routes
from dohyo.sumo_networks.freeway.drivers import KINDS, PROBE
from dohyo.sumo_networks.freeway.measure import MINUTE_S
from dohyo.sumo_networks.freeway.process import MESO, MICRO, start_sumo
from dohyo.sumo_networks.freeway.road import FreewayRoad, load_freeway
from dohyo.sumo_networks.freeway.scenario import FreewayScenario
from dohyo.sumo_networks.simulation.process import failing_as_simulation_error

Scale = Literal["meso", "micro"]
CRAWL_MPS = 5.5
"""Speed past an incident of a day in meso, where nothing can stand in a lane: about three quarters get through."""

MESO_JAM_FACTOR = 0.55
"""On standing gaps in meso: its queues are uniform with more, and have stop-and-go waves with this."""


@dataclass(frozen=True, eq=False)
class Measured:
    """What SUMO measured of one group of vehicles, T minutes and S segments.

    Attributes:
        speed_mps: (T, S) space-mean speed; NaN where no vehicle of the group was.
        seconds: (T, S) time that the group spent there, summed over vehicles.
        left: (T, S) vehicles that left the segment downstream, or by its ramp.
    """

    speed_mps: FloatArray
    seconds: FloatArray
    left: FloatArray


@dataclass(frozen=True, eq=False)
class SpeedDay:
    """A stretch of a day, T minutes.

    Attributes:
        minute: (T,) since midnight.
        truth: All vehicles.
        probes: Those whose speed is reported.
    """

    minute: FloatArray
    truth: Measured
    probes: Measured


def drive_day(scenario: FreewayScenario, scale: Scale, progress: Progress = lambda _share: None) -> SpeedDay:
    """Drives a scenario and measures it.

    Args:
        scenario: What to drive.
        scale: `meso` for queues, in a process of its own; `micro` for single vehicles, in this one.
        progress: Told the share that is done, 0 to 1.

    Raises:
        SimulationError: SUMO failed, or another simulation of this process is open (`micro`).
    """
    drive = partial(_drive_and_measure, scenario, scale)
    return drive(progress) if scale == "micro" else drive_apart(drive, progress)


def _drive_and_measure(scenario: FreewayScenario, scale: Scale, progress: Progress) -> SpeedDay:
    road = load_freeway(scenario.network)
    begin = max(scenario.start_s - scenario.warm_up_s, 0.0)
    minutes = round(scenario.duration_s / MINUTE_S)
    demand = draw_demand(road, scenario)
    seed = int(np.random.SeedSequence(scenario.seed).spawn(6)[5].generate_state(1)[0] % 2**31)
    with tempfile.TemporaryDirectory(prefix="dohyo-day-") as folder:
        routes, detectors = Path(folder) / "day.rou.xml", Path(folder) / "day.add.xml"
        if scale == "meso":
            calm = scenario.model_copy(update={"day": scenario.day.model_copy(update={"incidents": ()})})
            write_routes(road, calm, demand, routes, MESO_JAM_FACTOR)
        else:
            write_routes(road, scenario, demand, routes)
        detectors.write_text(_detectors(scenario, Path(folder)), encoding="utf-8")
        start_sumo(road.network.path, [routes, detectors], begin, seed, MESO if scale == "meso" else MICRO)
        try:
            _drive(road, scenario, scale, begin, progress)
        finally:
            libsumo.close()
        truth, probes = (_read(road, Path(folder) / f"{group}.xml", scenario.start_s, minutes) for group in _GROUPS)
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
        with failing_as_simulation_error(int(time_s)):
            for incident in scenario.day.incidents if scale == "meso" else ():
                edge, _ = road.edge_at(incident.position_m)
                crawls = incident.time_s <= time_s < incident.time_s + incident.duration_s
                libsumo.edge.setMaxSpeed(edge, CRAWL_MPS if crawls else usual[edge])
            libsumo.simulationStep(float(time_s))
        progress(min((time_s - begin_s) / (end - begin_s), 1.0))


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
