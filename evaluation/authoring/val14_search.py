"""The search for `val14`: cars that the ego may replace, and drives of the reference from their places."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dohyo.evaluation.authoring.draw_events import fits
from dohyo.evaluation.authoring.scenario_types import (
    CHANGE_WITHIN_M,
    STANDING_MPS,
    STANDING_OTHERS,
    STANDING_WITHIN_M,
    TYPES,
    Run,
)
from dohyo.evaluation.benchmarks.benchmark import Cell, Excerpt, ScriptedMission
from dohyo.evaluation.benchmarks.traffic_logs import Reference, drive_reference
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.errors import InvalidInputError, SimulationError
from dohyo.sumo_networks.geometry import boxes_overlap, wrap
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.routes.route import Route
from dohyo.sumo_networks.routes.routing import plan_route
from dohyo.sumo_networks.scenario import Mission, Place, Scenario, Traffic
from dohyo.sumo_networks.simulation import Simulation, plan_scenario
from dohyo.sumo_networks.simulation.traffic_log import write_log
from dohyo.sumo_networks.world import ActorKind, Actors, LightState, World

DURATION_S = 15.0
WARM_UP_S = 30.0
TRAFFIC: Mapping[str, Traffic] = {
    "adlershof": Traffic(vehicles=140, bicycles=10, pedestrians=30, warm_up_s=WARM_UP_S),
    "braunschweig": Traffic(vehicles=120, bicycles=10, pedestrians=30, warm_up_s=WARM_UP_S),
    "ingolstadt": Traffic(vehicles=60, bicycles=6, pedestrians=30, warm_up_s=WARM_UP_S),
    "district": Traffic(vehicles=100, bicycles=10, pedestrians=80, warm_up_s=WARM_UP_S),
}
TRAIN_SHARE = 4  # one edge in this many is for training
ALWAYS_STAGED = ("traversing-pickup-dropoff", "waiting-for-pedestrian-to-cross")
STAGED: Mapping[str, tuple[Mapping[str, str | float | int], ...]] = {
    "traversing-pickup-dropoff": ({"kind": "parking_crossing_pedestrian", "at_m": 3.0, "ahead_m": 35.0},),
    "waiting-for-pedestrian-to-cross": (
        {"kind": "pedestrian_group_crossing", "at_m": 3.0, "ahead_m": 35.0},
        {"kind": "pedestrian_steps_out", "at_m": 3.0, "ahead_m": 30.0},
    ),
    "behind-long-vehicle": ({"kind": "hard_brake", "at_m": 3.0, "actor": "truck", "appear_m": 18.0, "wait_s": 8.0},),
    "stopping-with-lead": ({"kind": "hard_brake", "at_m": 3.0, "appear_m": 25.0, "wait_s": 3.0},),
}


@dataclass(frozen=True)
class Snapshot:
    """The traffic of one network and seed at the time of the ego's start.

    Attributes:
        network: Network of the traffic.
        seed: Seed of the traffic.
        actors: All actors.
        world: World with the states of the lights.
    """

    network: RoadNetwork
    seed: int
    actors: Actors
    world: World


@dataclass(frozen=True)
class Candidate:
    """A car that the ego may replace.

    Attributes:
        row: Row in the actors of the snapshot.
        lane: Lane of the car.
        at_m: Position of its centre on that lane, in SUMO's measure, m.
        speed: Speed of the car, m/s.
        left_m: Distance to the end of the lane, m.
    """

    row: int
    lane: int
    at_m: float
    speed: float
    left_m: float


def take_snapshot(network_name: str, seed: int) -> Snapshot:
    """The traffic after it has warmed up without an ego."""
    network = load_network(network_name)
    long = int(np.argmax(np.where(network.lanes.drivable & ~network.lanes.internal, network.lanes.length, 0.0)))
    lane = str(network.lanes.ids[long])
    anywhere = Mission(
        start=Place(lane=lane, position_m=5.0), goal=Place(lane=lane, position_m=-5.0), start_speed_mps=0
    )
    scenario = Scenario(network=network_name, missions=(anywhere,), traffic=TRAFFIC[network_name], seed=seed)
    simulation = Simulation(plan_scenario(network, scenario))
    try:
        return Snapshot(network, seed, simulation.all_actors()[1], simulation.world)
    finally:
        simulation.close()


def cars(snapshot: Snapshot) -> list[Candidate]:
    """Cars that keep to the middle of an ordinary lane."""
    network, actors, found = snapshot.network, snapshot.actors, []
    for row in np.flatnonzero(actors.kind == ActorKind.CAR).tolist():
        lane = int(actors.lane[row])
        if lane < 0 or network.lanes.internal[lane] or not network.lanes.drivable[lane]:
            continue
        at, aside, direction = along(network.lane_shape(lane), actors.position[row])
        scale = float(network.lanes.length[lane]) / _arc(network.lane_shape(lane))[-1]
        left = float(network.lanes.length[lane]) - at * scale
        if abs(aside) < 0.3 and abs(wrap(float(actors.heading[row]) - direction)) < 0.1 and at > 4.0 and left > 4.0:
            found.append(Candidate(row, lane, round(at * scale, 2), round(float(actors.speed[row]), 2), left))
    return found


def propose(
    kind: str, snapshot: Snapshot, one: Candidate, rng: np.random.Generator, staged: bool
) -> ScriptedMission | None:
    """A mission from a car's place that may be of a type; None if it cannot."""
    if not promising(kind, snapshot, one, staged):
        return None
    network = snapshot.network
    turn = {"starting-left-turn": "lL", "starting-right-turn": "rR"}.get(kind, "s")
    turn = str(rng.choice(["lL", "rR"])) if kind == "high-lateral-acceleration" else turn
    lane = one.lane
    if kind == "changing-lane":
        lane, turn = _beside(network, one.lane)
    mission = route_from(network, one, lane, turn)
    if mission is None:
        return None
    try:
        route = plan_route(network, mission)
    except InvalidInputError:
        return None
    if not suits(kind, route):
        return None
    if staged and kind in STAGED:
        events = [event for event in STAGED[kind] if fits(event, network, route)]
        if not events:
            return None
        event = {"name": "event", **events[int(rng.integers(len(events)))]}
        return ScriptedMission.model_validate({**mission.model_dump(), "events": [event]})
    return ScriptedMission.model_validate(mission.model_dump())


def promising(kind: str, snapshot: Snapshot, one: Candidate, staged: bool) -> bool:
    """Whether the next 15 s of a car may be of a type: a fast guess, before anything is driven."""
    actors = snapshot.actors
    offset = actors.position - actors.position[one.row]
    heading = float(actors.heading[one.row])
    ahead, aside = offset @ (math.cos(heading), math.sin(heading)), offset @ (-math.sin(heading), math.cos(heading))
    vehicle = actors.kind <= ActorKind.BUS
    vehicle[one.row] = False
    led = vehicle & (ahead > 0) & (ahead < 35.0) & (np.abs(aside) < 1.5)
    nearest = int(np.argmin(np.where(led, ahead, np.inf))) if led.any() else -1
    standing, near = vehicle & (actors.speed < STANDING_MPS), np.hypot(ahead, aside) < STANDING_WITHIN_M
    in_s = one.left_m / max(one.speed, 2.0)
    green = _green(snapshot, one.lane)
    free = nearest < 0 or ahead[nearest] > one.left_m
    if staged and kind in STAGED:
        room = 40.0 if kind in ("traversing-pickup-dropoff", "waiting-for-pedestrian-to-cross") else 80.0
        return one.speed >= 4.5 and one.left_m > room and (nearest < 0 or ahead[nearest] > 30.0)
    tests: Mapping[str, bool] = {
        "starting-left-turn": green and in_s < 5.0 and free,
        "starting-right-turn": green and in_s < 5.0 and free,
        "starting-straight-traffic-light-intersection-traversal": green and in_s < 5.0 and free,
        "stopping-with-lead": nearest >= 0 and one.speed >= 4.5 and actors.speed[nearest] < 2.0,
        "high-lateral-acceleration": green and 1.0 < in_s < 8.0 and free,
        "high-magnitude-speed": one.speed >= 9.5 and (one.left_m > 90.0 or green) and free,
        "low-magnitude-speed": nearest >= 0 and 0.5 <= one.speed <= 4.0 and bool(ahead[nearest] < 14.0),
        "waiting-for-pedestrian-to-cross": one.speed >= 2.0
        and bool((actors.kind == ActorKind.PEDESTRIAN)[(ahead > 5) & (ahead < 40) & (np.abs(aside) < 8)].any()),
        "behind-long-vehicle": nearest >= 0 and actors.length[nearest] >= 8.0 and ahead[nearest] < 28.0,
        "stationary-in-traffic": one.speed < 0.1 and not green and int((standing & near).sum()) >= STANDING_OTHERS,
        "near-multiple-vehicles": int((vehicle & (np.hypot(ahead, aside) < 22.0)).sum()) >= 4 and one.speed > 1.0,
        "changing-lane": one.left_m > 45.0 and one.speed >= 3.0,
        "following-lane-with-lead": nearest >= 0
        and ahead[nearest] < 27.0
        and one.speed >= 5.0
        and bool(actors.speed[nearest] >= 4.0)
        and one.left_m > 50.0,
    }
    return bool(tests.get(kind, False))


def suits(kind: str, route: Route) -> bool:
    """Whether a route suits a scenario type."""
    if kind == "changing-lane":
        return bool(route.lane_changes) and route.lane_changes[0].start <= CHANGE_WITHIN_M
    if kind == "starting-straight-traffic-light-intersection-traversal":
        return bool(route.passages) and route.passages[0].signal >= 0
    return True


def confirm(
    kind: str, snapshot: Snapshot, mission: ScriptedMission, reference_agent: str
) -> tuple[ScriptedMission | None, list[str]]:
    """Drives the reference agent through a mission; returns the mission with its excerpt, and the types of the run.

    The mission is None if the reference arrived too early, touched another actor, or SUMO failed.
    """
    cell = Cell(name=kind, network=snapshot.network.name, missions="all", traffic=TRAFFIC[snapshot.network.name])
    scenario = scenario_of(cell, mission, snapshot.seed)
    try:
        reference = drive_reference(scenario, reference_agent)
    except SimulationError:
        return None, []
    if reference.goal or any(_touches(reference)):
        return None, []
    run = run_of(scenario, reference)
    types = [one for one, test in TYPES.items() if test(run)]
    return mission.model_copy(update={"excerpt": excerpt_of(snapshot.seed, reference)}), types


def scenario_of(cell: Cell, mission: ScriptedMission, seed: int) -> Scenario:
    """The scenario that the reference drives."""
    return Scenario(
        name=mission.name,
        cell=cell.name,
        network=cell.network,
        missions=(mission.mission("ego"),),
        traffic=cell.traffic,
        events=tuple(event.model_copy(update={"ego": None}) for event in mission.events),
        duration_s=DURATION_S,
        seed=seed,
    )


def run_of(scenario: Scenario, reference: Reference) -> Run:
    """The drive of the reference, for the tests of the types."""
    network, trajectory = load_network(scenario.network), reference.trajectory
    ego = trajectory.key == -1
    columns = (trajectory.heading, trajectory.speed, trajectory.progress)
    heading, speed, progress = (column[ego].astype(np.float64) for column in columns)
    position = np.column_stack([trajectory.x[ego], trajectory.y[ego]]).astype(np.float64)
    route = plan_route(network, scenario.missions[0])
    return Run(network, route, reference.log, heading, speed, position, progress)


def excerpt_of(seed: int, reference: Reference) -> Excerpt:
    """The excerpt of a reference's drive for the benchmark's file; also stores its log."""
    write_log(reference.log)
    return Excerpt(seed=seed, warm_up_s=WARM_UP_S, reference_m=reference.progress_m, log=reference.log.sha256())


def _beside(network: RoadNetwork, lane: int) -> tuple[int, str]:
    """A neighbour lane with a connection in a direction that the lane itself does not have; -1 if there is none."""
    connections = network.connections
    own = {str(connections.direction[c]) for c in network.connections_from(lane)}
    for neighbour in (int(network.lanes.left[lane]), int(network.lanes.right[lane])):
        if neighbour >= 0:
            more = {str(connections.direction[c]) for c in network.connections_from(neighbour)} - own - {"t"}
            if more:
                return neighbour, min(more)
    return -1, "s"


def route_from(network: RoadNetwork, one: Candidate, lane: int, turn: str) -> Mission | None:
    """A mission of 15 s or more from a car's place: at the first junction in a given direction, then straight on."""
    lanes, connections = network.lanes, network.connections
    if lane < 0:
        return None
    need = DURATION_S * 1.1 * max(float(lanes.speed[lane]), 10.0) + 20.0
    length, here, edges, first = one.left_m, lane, [], True
    while length < need:
        onward = [c for c in network.connections_from(here) if lanes.drivable[connections.target[c]]]
        wished = [c for c in onward if str(connections.direction[c]) in (turn if first else "s") + "i"]
        if not onward or (first and not wished and not lanes.internal[here]):
            return None
        here = int(connections.target[(wished or onward)[0]])
        length += float(lanes.length[here])
        if not lanes.internal[here]:
            first = False
            edges.append(network.edge_id(here))
    if not edges:
        goal = Place(lane=str(lanes.ids[lane]), position_m=round(float(lanes.length[lane]) - 3.0, 1))
    elif lanes.internal[here]:
        return None
    else:
        goal = Place(lane=str(lanes.ids[here]), position_m=round(0.9 * float(lanes.length[here]), 1))
    start = Place(lane=str(lanes.ids[one.lane]), position_m=one.at_m)
    return Mission(start=start, goal=goal, via=tuple(edges[:-1]), start_speed_mps=one.speed)


def along(shape: FloatArray, point: FloatArray) -> tuple[float, float, float]:
    """Arc length [m], signed distance [m, left positive] and direction [rad] of a polyline, nearest to a point."""
    arc, best = _arc(shape), (math.inf, 0.0, 0.0, 0.0)
    for i, (a, b) in enumerate(pairwise(shape)):
        step = b - a
        length = float(np.hypot(*step))
        if length == 0.0:
            continue
        t = float(np.clip((point - a) @ step / length**2, 0.0, 1.0))
        dx, dy = point - a - t * step
        side = math.copysign(math.hypot(dx, dy), step[0] * dy - step[1] * dx)
        best = min(best, (math.hypot(dx, dy), float(arc[i]) + t * length, side, math.atan2(step[1], step[0])))
    return best[1:]


def _arc(shape: FloatArray) -> FloatArray:
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(shape, axis=0).T))])


def _green(snapshot: Snapshot, lane: int) -> bool:
    """Whether the lights at the end of a lane show no red."""
    connections = snapshot.network.connections
    signals = [int(connections.signal[c]) for c in snapshot.network.connections_from(lane)]
    return all(s < 0 or snapshot.world.signals[s] == LightState.GREEN for s in signals)


def belongs(network: RoadNetwork, lane: int, train: bool) -> bool:
    """Whether the edge of a lane belongs to the training benchmark."""
    digest = hashlib.sha256(network.edge_id(lane).encode()).digest()
    return (digest[0] % TRAIN_SHARE == 0) is train


def _touches(reference: Reference) -> Iterator[bool]:
    """For each tick, whether the reference touched another actor: such a run is rejected."""
    trajectory = reference.trajectory
    ego = np.flatnonzero(trajectory.key == -1)
    for tick, row in enumerate(ego.tolist()):
        columns = (trajectory.x, trajectory.y, trajectory.heading, trajectory.length, trajectory.width)
        box = np.array([[float(column[row]) for column in columns]])
        boxes = reference.log.actors(tick).boxes()
        yield bool(boxes_overlap(box, boxes).any())
