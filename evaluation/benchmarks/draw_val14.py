"""Draws `val14` and `val14-train`: python -m evaluation.benchmarks.draw_val14 NAME [--pin].

For each seed the traffic of a network warms up for 30 s. Every car in it is a candidate: the ego takes its place, at
its speed, with a route that may make a scenario of some type of it. The reference then drives 15 s in live traffic, and
the candidate is kept if the run passes that type's test in `evaluation.scenario_types`. Types that traffic alone gives
too rarely get a scripted event on the way, and have to pass the same test.

Places and seeds of both benchmarks are apart: an edge belongs to one of them by a hash of its name. What a file has
already is kept, and what it lacks is drawn. `--pin` keeps all missions, drives the reference anew, and writes its logs
and progress: for when the reference or the simulation changed.
"""

from __future__ import annotations

import argparse
import hashlib
import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from evaluation.benchmark import CLOSED_LOOP, Benchmark, Cell, Excerpt, ScriptedMission, load_benchmark
from evaluation.benchmarks.draw_events import fits
from evaluation.logs import Reference, drive_reference
from evaluation.scenario_types import CHANGE_WITHIN_M, STANDING_MPS, STANDING_OTHERS, STANDING_WITHIN_M, TYPES, Run
from sumo_networks.arrays import FloatArray
from sumo_networks.catalog import load_network
from sumo_networks.errors import InvalidInputError, SimulationError
from sumo_networks.geometry import boxes_overlap, wrap
from sumo_networks.log import write_log
from sumo_networks.network import RoadNetwork
from sumo_networks.routing import Route, plan_route
from sumo_networks.scenario import Mission, Place, Scenario, Traffic
from sumo_networks.simulation import Simulation
from sumo_networks.world import ActorKind, Actors, LightState, World

DURATION_S = 15.0
WARM_UP_S = 30.0
TRAFFIC: Mapping[str, Traffic] = {
    "adlershof": Traffic(vehicles=140, bicycles=10, pedestrians=30, warm_up_s=WARM_UP_S),
    "braunschweig": Traffic(vehicles=120, bicycles=10, pedestrians=30, warm_up_s=WARM_UP_S),
    "ingolstadt": Traffic(vehicles=60, bicycles=6, pedestrians=30, warm_up_s=WARM_UP_S),
    "district": Traffic(vehicles=100, bicycles=10, pedestrians=80, warm_up_s=WARM_UP_S),
}
SEARCHED = ("district", "ingolstadt", "braunschweig", "adlershof")  # the quickest first
TRAIN_SHARE = 4  # one edge in so many
QUARTERS_UNTIL = 1  # seeds
TRIES = 3  # candidates per network, seed and type
LONGEST_SEARCH = 60  # seeds
SAME_PLACE_FROM = 6  # seeds after which a type may come twice on one edge, at different moments
ALWAYS_STAGED = ("traversing-pickup-dropoff", "waiting-for-pedestrian-to-cross")
_STAGED: Mapping[str, tuple[Mapping[str, str | float | int], ...]] = {
    "traversing-pickup-dropoff": ({"kind": "parking_crossing_pedestrian", "at_m": 3.0, "ahead_m": 35.0},),
    "waiting-for-pedestrian-to-cross": (
        {"kind": "pedestrian_group_crossing", "at_m": 3.0, "ahead_m": 35.0},
        {"kind": "pedestrian_steps_out", "at_m": 3.0, "ahead_m": 30.0},
    ),
    "behind-long-vehicle": ({"kind": "hard_brake", "at_m": 3.0, "actor": "truck", "appear_m": 18.0, "wait_s": 8.0},),
    "stopping-with-lead": ({"kind": "hard_brake", "at_m": 3.0, "appear_m": 25.0, "wait_s": 3.0},),
}


Found = tuple[str, str, ScriptedMission]
"""Type, network and mission of one scenario."""


@dataclass(frozen=True)
class Snapshot:
    """The traffic of one network and seed when the ego would start.

    Attributes:
        network: The roads.
        seed: Of the traffic.
        actors: Everybody.
        world: For the lights.
    """

    network: RoadNetwork
    seed: int
    actors: Actors
    world: World


@dataclass(frozen=True)
class Candidate:
    """A car whose place the ego may take.

    Attributes:
        row: In the snapshot's actors.
        lane: It is on.
        at_m: Its centre on that lane, m as SUMO measures it.
        speed: m/s.
        left_m: To the end of the lane, m.
    """

    row: int
    lane: int
    at_m: float
    speed: float
    left_m: float


def draw(name: str, per_type: int, first_seed: int, train: bool, there: Sequence[Found] = ()) -> Iterator[Found]:
    """Type, network and mission of each scenario that is still missing, as it is found.

    Args:
        name: For the scenarios while they are tried.
        per_type: How many of each type.
        first_seed: Of the traffic.
        train: Whose edges to use.
        there: What was found before.

    Raises:
        InvalidInputError: Some type could not be found so often.
    """
    found = Counter(kind for kind, _, _ in there)
    local = Counter((kind, network_name) for kind, network_name, _ in there)
    used = {(kind, network_name, mission.start.lane.rpartition("_")[0]) for kind, network_name, mission in there}
    moments = {(mission.excerpt.seed, mission.start) for _, _, mission in there if mission.excerpt}
    # Seeds that were searched before would only fail again.
    begin = max((seed - first_seed + 1 for seed, _ in moments), default=0)
    for number in range(begin, begin + LONGEST_SEARCH):
        # Each network gives its quarter first; what one has not, the others may give.
        share = per_type if number >= QUARTERS_UNTIL else math.ceil(per_type / len(TRAFFIC))
        for network_name in SEARCHED:
            wanted = [one for one in TYPES if found[one] < per_type and local[one, network_name] < share]
            if not wanted:
                continue
            snapshot = take_snapshot(network_name, first_seed + number)
            candidates = [one for one in cars(snapshot) if _of(snapshot.network, one.lane, train)]
            for kind in wanted:
                rng = np.random.default_rng([first_seed, number, list(TYPES).index(kind)])
                staged = kind in ALWAYS_STAGED or (kind in _STAGED and number >= 2)
                tries = 0
                for i in rng.permutation(len(candidates)):
                    edge = snapshot.network.edge_id(candidates[i].lane)
                    if tries >= TRIES or (number < SAME_PLACE_FROM and (kind, network_name, edge) in used):
                        continue
                    mission = propose(kind, snapshot, candidates[i], rng, staged)
                    if mission is None or (snapshot.seed, mission.start) in moments:
                        continue
                    tries += 1
                    kept, types = confirm(kind, snapshot, mission)
                    if kept is not None:
                        # A run that is not of the type it was meant for may be of another that is still wanted.
                        own = [one for one in types if found[one] < per_type and local[one, network_name] < share]
                        chosen = kind if kind in own else min(own, key=lambda one: found[one], default=None)
                        moments.add((snapshot.seed, mission.start))
                        if chosen is not None:
                            used.add((chosen, network_name, edge))
                            found[chosen] += 1
                            local[chosen, network_name] += 1
                            print(f"{name}: {chosen} {found[chosen]}/{per_type} on {network_name}", flush=True)
                            yield chosen, network_name, kept
                    if found[kind] >= per_type or local[kind, network_name] >= share:
                        break
        if all(found[kind] >= per_type for kind in TYPES):
            return
    missing = {kind: per_type - found[kind] for kind in TYPES if found[kind] < per_type}
    raise InvalidInputError(f"{name}: not found often enough: {missing}")


def take_snapshot(network_name: str, seed: int) -> Snapshot:
    """The traffic when it has warmed up without an ego."""
    network = load_network(network_name)
    long = int(np.argmax(np.where(network.lanes.drivable & ~network.lanes.internal, network.lanes.length, 0.0)))
    lane = str(network.lanes.ids[long])
    anywhere = Mission(
        start=Place(lane=lane, position_m=5.0), goal=Place(lane=lane, position_m=-5.0), start_speed_mps=0
    )
    scenario = Scenario(network=network_name, missions=(anywhere,), traffic=TRAFFIC[network_name], seed=seed)
    simulation = Simulation(network, scenario)
    try:
        world = simulation.start()
        return Snapshot(network, seed, simulation.everybody(), world)
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
    """A mission from a car's place that may be of a type; None where it cannot."""
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
    if staged and kind in _STAGED:
        events = [event for event in _STAGED[kind] if fits(event, network, route)]
        if not events:
            return None
        event = {"name": "event", **events[int(rng.integers(len(events)))]}
        return ScriptedMission.model_validate({**mission.model_dump(), "events": [event]})
    return ScriptedMission.model_validate(mission.model_dump())


def promising(kind: str, snapshot: Snapshot, one: Candidate, staged: bool) -> bool:
    """Whether a car's state lets its next 15 s be of a type: a cheap guess, before anything is driven."""
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
    if staged and kind in _STAGED:
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
    """Whether a route has what its type needs."""
    if kind == "changing-lane":
        return bool(route.lane_changes) and route.lane_changes[0].start <= CHANGE_WITHIN_M
    if kind == "starting-straight-traffic-light-intersection-traversal":
        return bool(route.passages) and route.passages[0].signal >= 0
    return True


def confirm(kind: str, snapshot: Snapshot, mission: ScriptedMission) -> tuple[ScriptedMission | None, list[str]]:
    """Drives the reference through a mission; the mission with its excerpt, and the types of the run.

    There is none where the reference arrived too early, touched somebody, or SUMO failed.
    """
    cell = Cell(name=kind, network=snapshot.network.name, missions="all", traffic=TRAFFIC[snapshot.network.name])
    scenario = scenario_of(cell, mission, snapshot.seed)
    try:
        reference = drive_reference(scenario)
    except SimulationError:
        return None, []
    if reference.goal or any(_touches(reference)):
        return None, []
    run = run_of(scenario, reference)
    types = [one for one, test in TYPES.items() if test(run)]
    return mission.model_copy(update={"excerpt": excerpt_of(snapshot.seed, reference)}), types


def scenario_of(cell: Cell, mission: ScriptedMission, seed: int) -> Scenario:
    """What the reference drives."""
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
    """The reference's drive, for the tests of the types."""
    network, trajectory = load_network(scenario.network), reference.trajectory
    ego = trajectory.key == -1
    columns = (trajectory.heading, trajectory.speed, trajectory.progress)
    heading, speed, progress = (column[ego].astype(np.float64) for column in columns)
    position = np.column_stack([trajectory.x[ego], trajectory.y[ego]]).astype(np.float64)
    route = plan_route(network, scenario.missions[0])
    return Run(network, route, reference.log, heading, speed, position, progress)


def excerpt_of(seed: int, reference: Reference) -> Excerpt:
    """What the benchmark's file says of a reference; its log is kept."""
    write_log(reference.log)
    return Excerpt(seed=seed, warm_up_s=WARM_UP_S, reference_m=reference.progress_m, log=reference.log.sha256())


def _beside(network: RoadNetwork, lane: int) -> tuple[int, str]:
    """A neighbour from which one may leave in a direction that the lane itself does not have; -1 if there is none."""
    connections = network.connections
    own = {str(connections.direction[c]) for c in network.connections_from(lane)}
    for neighbour in (int(network.lanes.left[lane]), int(network.lanes.right[lane])):
        if neighbour >= 0:
            more = {str(connections.direction[c]) for c in network.connections_from(neighbour)} - own - {"t"}
            if more:
                return neighbour, min(more)
    return -1, "s"


def route_from(network: RoadNetwork, one: Candidate, lane: int, turn: str) -> Mission | None:
    """A mission from a car's place by the first junction in one of some directions, then straight on, 15 s or more."""
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
    """Arc length [m], signed distance [m, left positive] and direction [rad] of a polyline where a point is nearest."""
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
    """Whether no light is red at the end of a lane."""
    connections = snapshot.network.connections
    signals = [int(connections.signal[c]) for c in snapshot.network.connections_from(lane)]
    return all(s < 0 or snapshot.world.signals[s] == LightState.GREEN for s in signals)


def _of(network: RoadNetwork, lane: int, train: bool) -> bool:
    """Whether the edge of a lane belongs to the training benchmark, or to the other."""
    digest = hashlib.sha256(network.edge_id(lane).encode()).digest()
    return (digest[0] % TRAIN_SHARE == 0) is train


def _touches(reference: Reference) -> Iterator[bool]:
    """Whether the reference touched somebody, tick by tick: such a run is no example."""
    trajectory = reference.trajectory
    ego = np.flatnonzero(trajectory.key == -1)
    for tick, row in enumerate(ego.tolist()):
        columns = (trajectory.x, trajectory.y, trajectory.heading, trajectory.length, trajectory.width)
        box = np.array([[float(column[row]) for column in columns]])
        boxes = reference.log.actors(tick).boxes()
        yield bool(boxes_overlap(box, boxes).any())


def lines(name: str, found: Sequence[Found]) -> Iterator[str]:
    """Lines of a benchmark's file."""
    what = "train a planner on" if name.endswith("train") else "the 14 scenario types of nuPlan's challenge"
    yield f'name = "{name}"'
    yield f'description = "{len(found)} scenarios of 15 s: {what}; all others replay a recorded run"'
    yield f'metric = "{CLOSED_LOOP}"'
    yield "seeds = [0]"
    yield f"duration_s = {DURATION_S}"
    yield "replay = true"
    groups: dict[tuple[str, str], list[ScriptedMission]] = {}
    for kind in TYPES:
        for network in TRAFFIC:
            some = [mission for one, where, mission in found if (one, where) == (kind, network)]
            if some:
                groups[kind, network] = some
    for kind, network in groups:
        t = TRAFFIC[network]
        traffic = f"vehicles = {t.vehicles}, bicycles = {t.bicycles}, pedestrians = {t.pedestrians}"
        yield from ("", "[[cells]]", f'name = "{kind}.{network}"', f'network = "{network}"')
        yield from (f'missions = "{kind}-{network}"', f"traffic = {{ {traffic} }}")
    for (kind, network), some in groups.items():
        for number, mission in enumerate(some, start=1):
            yield from ("", f"[[missions.{kind}-{network}]]", *_mission(number, mission))


def _mission(number: int, mission: ScriptedMission) -> Iterator[str]:
    excerpt = mission.excerpt
    assert excerpt is not None
    yield f'name = "m{number:02d}"'
    for what, place in (("start", mission.start), ("goal", mission.goal)):
        yield f'{what} = {{ lane = "{place.lane}", position_m = {place.position_m} }}'
    if mission.via:
        yield "via = [" + ", ".join(f'"{edge}"' for edge in mission.via) + "]"
    yield f"start_speed_mps = {mission.start_speed_mps}"
    yield (
        f"excerpt = {{ seed = {excerpt.seed}, warm_up_s = {excerpt.warm_up_s}, reference_m = {excerpt.reference_m}, "
        f'log = "{excerpt.log}" }}'
    )
    for event in mission.events:
        fields = event.model_dump(mode="json", exclude_defaults=True, exclude_none=True) | {"kind": event.kind}
        yield "events = [{ " + ", ".join(f"{key} = {_toml(value)}" for key, value in fields.items()) + " }]"


def _toml(value: object) -> str:
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return str(value).lower() if isinstance(value, bool) else str(value)


def pinned(benchmark: Benchmark, workers: int) -> Iterator[Found]:
    """The missions of a benchmark, with what the reference does in them today.

    A run that is no longer of its type is named, and kept: its place in the list is part of the benchmark.
    """
    todo = [(cell, mission) for cell in benchmark.cells for mission in benchmark.missions[cell.missions]]
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        yield from pool.map(_pin, todo)


def _pin(one: tuple[Cell, ScriptedMission]) -> Found:
    cell, mission = one
    kind = cell.name.partition(".")[0]
    assert mission.excerpt is not None
    warm = cell.traffic.model_copy(update={"warm_up_s": mission.excerpt.warm_up_s})
    scenario = scenario_of(cell.model_copy(update={"traffic": warm}), mission, mission.excerpt.seed)
    reference = drive_reference(scenario)
    if not TYPES[kind](run_of(scenario, reference)):
        print(f"{cell.name} {mission.name}: the reference's run is no longer of this type", flush=True)
    return kind, cell.network, mission.model_copy(update={"excerpt": excerpt_of(mission.excerpt.seed, reference)})


BENCHMARKS = {
    "val14": partial(draw, "val14", 20, 1000, False),
    "val14-train": partial(draw, "val14-train", 5, 5000, True),
}


def missions_of(benchmark: Benchmark) -> list[Found]:
    """What a benchmark's file holds."""
    return [
        (cell.name.partition(".")[0], cell.network, mission)
        for cell in benchmark.cells
        for mission in benchmark.missions[cell.missions]
    ]


def write(name: str, pin: bool, workers: int) -> None:
    """Draws what a benchmark's file lacks, or pins what it has; what was found is kept if this is interrupted."""
    file = Path(__file__).with_name(f"{name}.toml")
    found = missions_of(load_benchmark(name)) if file.exists() and not pin else []
    for one in pinned(load_benchmark(name), workers) if pin else BENCHMARKS[name](there=tuple(found)):
        found.append(one)
        if not pin:
            file.write_text("\n".join(lines(name, found)) + "\n")
    file.write_text("\n".join(lines(name, found)) + "\n")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Draws a benchmark of recorded scenarios.")
    parser.add_argument("name", choices=BENCHMARKS)
    parser.add_argument("--pin", action="store_true", help="keep the missions, renew logs and references")
    parser.add_argument("--workers", type=int, default=1, help="processes that pin")
    arguments = parser.parse_args()
    write(arguments.name, arguments.pin, arguments.workers)
