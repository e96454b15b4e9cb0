"""Scenarios of the sub-policies: a short mission that needs one manoeuvre, drawn from a seed.

    scenario = draw_scenario(Manoeuvre.LIGHTS, seed=7)     # 30 to 100 m before a light

Everything follows from manoeuvre and seed. The trainer decides which seeds are held out.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np
from pydantic import TypeAdapter

from dohyo.agents.hierarchical.options.manoeuvres import DRIVE, Manoeuvre
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.events import Event
from dohyo.sumo_networks.events.placement import check_placement
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.routes.route import Route
from dohyo.sumo_networks.routes.routing import plan_route
from dohyo.sumo_networks.scenario import Mission, Obstacle, Place, Scenario, Traffic

ATTEMPTS = 8000
PLACES_TRIED = 8
TOWN, DISTRICT = "town-train", "district"
CURVE_M_S2, SLOWING_M_S2 = 2.0, 1.5
LIGHTLESS_M = 60.0
CHANGE_ROOM_M = 130.0
BLOCKED_AHEAD_M = (55.0, 85.0)
WARM_UP_S = 8.0
BUSY = (8, 20, 40, 80)
QUIET_SHARE = 0.4
LONGEST_CYCLE_S = 90.0
LIGHT_AHEAD_M = (8.0, 100.0)
TIME_LIMITS_S: Mapping[str, float] = MappingProxyType(
    {
        Manoeuvre.LANE: 30.0,
        Manoeuvre.LEFT: 15.0,
        Manoeuvre.RIGHT: 15.0,
        Manoeuvre.BRAKING: 60.0,
        Manoeuvre.LIGHTS: 60.0,
        DRIVE: 200.0,
    }
)
BRAKING_EVENTS: tuple[Mapping[str, object], ...] = (
    {"kind": "vehicle_appears", "stay_s": 8.0},
    {"kind": "parking_cut_in"},
    {"kind": "oncoming_in_lane"},
    {"kind": "opposite_takes_priority"},
    {"kind": "left_turn_unsignalised"},
    {"kind": "pedestrian_steps_out"},
    {"kind": "dynamic_object_crossing"},
    {"kind": "lead_vehicle_brakes"},
    {"kind": "hard_brake", "stop_s": 5.0},
)
GIVING_WAY = 6
"""Exercises of braking without an event, per exercise of each event."""
NEVER_IN_TOWN = {"opposite_takes_priority", "left_turn_unsignalised"}
_EVENT: TypeAdapter[Event] = TypeAdapter(Event)
_Draw = Callable[[np.random.Generator, int], Scenario | None]


def draw_scenario(what: str, seed: int) -> Scenario:
    """The scenario of one episode.

    Args:
        what: A `Manoeuvre`, or "drive".
        seed: Of everything.

    Raises:
        InvalidInputError: No scenario was found within `ATTEMPTS` draws.
    """
    rng = np.random.default_rng([zlib.crc32(what.encode()), seed])
    for _ in range(ATTEMPTS):
        scenario = _DRAWS[what](rng, seed)
        if scenario is not None:
            return scenario
    raise InvalidInputError(f"no scenario for '{what}' with seed {seed} in {ATTEMPTS} draws")


def careful_speed(route: Route) -> float:
    """Highest speed at a route's start from which gentle braking meets every limit and curve, m/s."""
    curve = np.sqrt(CURVE_M_S2 / np.maximum(np.abs(route.curvature), 1e-3))
    allowed = np.minimum(route.speed_limit, curve)
    at = np.arange(len(allowed), dtype=np.float64) * route.length / (len(allowed) - 1)
    return float(np.sqrt(allowed**2 + 2.0 * SLOWING_M_S2 * at).min())


def _lane(rng: np.random.Generator, seed: int) -> Scenario | None:
    """Roads, bends and turns, alone or in traffic; no light near the start: another sub-policy learns lights."""
    name = TOWN if rng.random() < 0.7 else DISTRICT
    network = load_network(name)
    start = _anywhere(rng, network)
    if _metres_to_light(network, start) < LIGHTLESS_M:
        return None
    found = _planned(network, Mission(start=start, goal=_anywhere(rng, network)), 120.0, 400.0)
    if found is None or _first_light(found[1]) < LIGHTLESS_M:
        return None
    return _busy(rng, Manoeuvre.LANE, name, _moving(rng, *found), seed)


def _change(manoeuvre: Manoeuvre) -> _Draw:
    """A straight road with a lane beside, alone or with a few cars; in half of the draws its own lane is blocked."""

    def draw(rng: np.random.Generator, seed: int) -> Scenario | None:
        network = load_network(DISTRICT)
        lanes = network.lanes
        beside = lanes.left if manoeuvre is Manoeuvre.LEFT else lanes.right
        long = np.flatnonzero(lanes.drivable & ~lanes.internal & (beside >= 0) & (lanes.length > CHANGE_ROOM_M + 25.0))
        lane = int(rng.choice(long, p=lanes.length[long] / lanes.length[long].sum()))
        at = float(rng.uniform(10.0, lanes.length[lane] - CHANGE_ROOM_M - 10.0))
        mission = Mission(start=_at(network, lane, at), goal=_at(network, lane, at + CHANGE_ROOM_M))
        route = plan_route(network, mission)
        blocked = (_blocking(rng, route),) if rng.random() < 0.5 else ()
        vehicles = 0 if blocked else int(rng.choice([0, 20]))
        moving = _moving(rng, mission, route, least=4.0)
        return _scenario(manoeuvre, DISTRICT, moving, seed, vehicles, obstacles=blocked)

    return draw


def _braking(rng: np.random.Generator, seed: int) -> Scenario | None:
    """An actor appears, crosses, comes or brakes ahead, and leaves again; or there is traffic to yield to."""
    which = seed % (len(BRAKING_EVENTS) + GIVING_WAY)  # not at random: events that fit in few places would be rare
    kind = BRAKING_EVENTS[which] if which < len(BRAKING_EVENTS) else None
    in_town = rng.random() < 0.6 and (kind is None or kind["kind"] not in NEVER_IN_TOWN)
    name = TOWN if in_town else DISTRICT
    network = load_network(name)
    found = _mission(rng, network, 130.0, 350.0)
    if found is None or _first_light(found[1]) < LIGHTLESS_M:
        return None
    if kind is None:
        mission = _moving(rng, *found)
        vehicles = int(rng.choice(BUSY))
        return _scenario(Manoeuvre.BRAKING, name, mission, seed, vehicles, pedestrians=2 * vehicles)
    event = _event(rng, kind, network, found[1], 8.0, 50.0)
    if event is None:
        return None
    return _busy(rng, Manoeuvre.BRAKING, name, _moving(rng, *found), seed, events=(event,))


def _lights(rng: np.random.Generator, seed: int) -> Scenario | None:
    """A light 8 to 100 m ahead, at any moment of its cycle, with or without a queue."""
    name = TOWN if rng.random() < 0.8 else DISTRICT
    network = load_network(name)
    found = _mission(rng, network, 60.0, 500.0)
    if found is None or not LIGHT_AHEAD_M[0] < _first_light(found[1]) < LIGHT_AHEAD_M[1]:
        return None
    moving, waited = _moving(rng, *found), float(rng.uniform(0.0, LONGEST_CYCLE_S))
    return _busy(rng, Manoeuvre.LIGHTS, name, moving, seed, warm_up_s=round(waited, 1))


def _drive(rng: np.random.Generator, seed: int) -> Scenario | None:
    """A mission through town in any traffic, as NoCrash's; every third may have an event."""
    network = load_network(TOWN)
    found = _mission(rng, network, 300.0, 1000.0)
    if found is None:
        return None
    kind = BRAKING_EVENTS[seed // 3 % len(BRAKING_EVENTS)]
    event = _event(rng, kind, network, found[1], 20.0, 200.0) if seed % 3 == 0 else None
    events, vehicles = () if event is None else (event,), int(rng.choice([0, 10, 20, 60]))
    return _scenario(DRIVE, TOWN, found[0], seed, vehicles, pedestrians=2 * vehicles, warm_up_s=20.0, events=events)


_DRAWS: Mapping[str, _Draw] = MappingProxyType(
    {
        Manoeuvre.LANE: _lane,
        Manoeuvre.LEFT: _change(Manoeuvre.LEFT),
        Manoeuvre.RIGHT: _change(Manoeuvre.RIGHT),
        Manoeuvre.BRAKING: _braking,
        Manoeuvre.LIGHTS: _lights,
        DRIVE: _drive,
    }
)


def _busy(
    rng: np.random.Generator,
    what: str,
    network: str,
    mission: Mission,
    seed: int,
    warm_up_s: float = WARM_UP_S,
    events: tuple[Event, ...] = (),
) -> Scenario:
    """No traffic in some draws, light to regular traffic with pedestrians in the others."""
    vehicles = 0 if rng.random() < QUIET_SHARE else int(rng.choice(BUSY))
    return _scenario(what, network, mission, seed, vehicles, 2 * vehicles, warm_up_s, events)


def _scenario(
    what: str,
    network: str,
    mission: Mission,
    seed: int,
    vehicles: int = 0,
    pedestrians: int = 0,
    warm_up_s: float = WARM_UP_S,
    events: tuple[Event, ...] = (),
    obstacles: tuple[Obstacle, ...] = (),
) -> Scenario:
    warmed = warm_up_s if vehicles or what == Manoeuvre.LIGHTS else 0.0
    return Scenario(
        name=f"{what}-{seed}",
        cell=what,
        network=network,
        missions=(mission,),
        traffic=Traffic(vehicles=vehicles, pedestrians=pedestrians, warm_up_s=warmed),
        events=events,
        obstacles=obstacles,
        time_limit_s=TIME_LIMITS_S[what],
        seed=seed,
    )


def _mission(rng: np.random.Generator, network: RoadNetwork, low: float, high: float) -> tuple[Mission, Route] | None:
    return _planned(network, Mission(start=_anywhere(rng, network), goal=_anywhere(rng, network)), low, high)


def _planned(network: RoadNetwork, mission: Mission, low: float, high: float) -> tuple[Mission, Route] | None:
    """Mission with its route, if that has a length within a range [m] and no U-turn."""
    if math.dist(_point(network, mission.start), _point(network, mission.goal)) > high:  # cheaper than planning
        return None
    try:
        route = plan_route(network, mission)
    except InvalidInputError:
        return None
    back = any(network.connections.direction[passage.connection] == "t" for passage in route.passages)
    return None if back or not low <= route.length <= high else (mission, route)


def _moving(rng: np.random.Generator, mission: Mission, route: Route, least: float = 0.0) -> Mission:
    """The mission from a rolling start, at any speed that the road ahead allows; every fourth from standstill."""
    if least == 0.0 and rng.random() < 0.25:
        return mission
    most = max(0.9 * careful_speed(route), least)
    return mission.model_copy(update={"start_speed_mps": round(float(rng.uniform(least, most)), 1)})


def _blocking(rng: np.random.Generator, route: Route) -> Obstacle:
    row = route.index(float(rng.uniform(*BLOCKED_AHEAD_M)))
    x, y = route.position[row].tolist()
    return Obstacle(x_m=x, y_m=y, heading_rad=float(route.heading[row]), length_m=4.5, width_m=1.8)


def _event(
    rng: np.random.Generator,
    kind: Mapping[str, object],
    network: RoadNetwork,
    route: Route,
    low: float,
    high: float,
) -> Event | None:
    """An event triggered within a range of the route [m]; None if no tried place fits."""
    for at in rng.uniform(low, high, PLACES_TRIED).round(1).tolist():
        event = _EVENT.validate_python({"name": "event", "at_m": at, **kind})
        try:
            check_placement(event, "ego", network, route)
        except InvalidInputError:
            continue
        return event
    return None


def _point(network: RoadNetwork, place: Place) -> tuple[float, float]:
    """Position of a place, m, network frame."""
    shape = network.lane_shape(network.lane_index[place.lane])
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(shape, axis=0).T))])
    x, y = (float(np.interp(place.position_m, arc, shape[:, i])) for i in (0, 1))
    return x, y


def _first_light(route: Route) -> float:
    """Distance from a route's start to the first junction with lights, m; infinite without one."""
    return min((passage.entry for passage in route.passages if passage.signal >= 0), default=math.inf)


def _metres_to_light(network: RoadNetwork, place: Place) -> float:
    """Distance from a place to the light at the end of its lane, m; infinite without one."""
    lane = network.lane_index[place.lane]
    lit = any(network.connections.signal[c] >= 0 for c in network.connections_from(lane))
    return float(network.lanes.length[lane]) - place.position_m if lit else math.inf


def _anywhere(rng: np.random.Generator, network: RoadNetwork) -> Place:
    lane = int(rng.choice(network.lanes.longer_than(40.0)))
    return _at(network, lane, float(rng.uniform(8.0, network.lanes.length[lane] - 15.0)))


def _at(network: RoadNetwork, lane: int, position: float) -> Place:
    return Place(lane=str(network.lanes.ids[lane]), position_m=round(position, 1))
