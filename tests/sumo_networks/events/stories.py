"""One place in the catalog for every kind of event, and an ego that drives there."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from pydantic import TypeAdapter

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.envs.driving_env import DrivingEnv
from dohyo.sumo_networks.events import Event
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.routes.route import Route
from dohyo.sumo_networks.routes.routing import plan_route
from dohyo.sumo_networks.scenario import Mission, Place, Scenario
from dohyo.sumo_networks.world import EventPhase, EventState, World

EVENT: TypeAdapter[Event] = TypeAdapter(Event)
OVER = (EventPhase.DONE, EventPhase.TIMED_OUT)
Driver = Callable[[World], float | tuple[float, float]]


def mission(start: str, start_m: float, goal: str) -> Mission:
    return Mission(start=Place(lane=start, position_m=start_m), goal=Place(lane=goal, position_m=-5.0))


TOWN = ("town-test", mission("rampart_1_1", 5.0, "quay_1_1"))
OTHER_TOWN = ("town-test", mission("quay_1_1", 5.0, "rampart_3_1"))
COUNTRY = ("district", mission("hill_road_2_1", 5.0, "avenue_6_2"))
COUNTRY_END = ("district", mission("hill_road_2_1", 265.0, "avenue_6_2"))
AVENUE = ("district", mission("garden_street_2_1", 5.0, "avenue_1_near_east_2"))
HIGHWAY = ("a10", mission("360414561_0", 5.0, "5067107#1_0"))
EXIT = ("a10", mission("240042212_1", 5.0, "24498409_0"))


@dataclass(frozen=True)
class Story:
    """An event on a mission.

    Attributes:
        kind: Of the event.
        place: Network and mission.
        at_m: The trigger.
        speed: At which the ego drives, m/s.
        demands: Whether an ego that keeps its speed and lane hits somebody.
    """

    kind: str
    place: tuple[str, Mission]
    at_m: float
    speed: float = 9.0
    demands: bool = True

    def scenario(self, seed: int = 0, **changes: object) -> Scenario:
        network, way = self.place
        event = EVENT.validate_python({"kind": self.kind, "name": "it", "at_m": self.at_m, **changes})
        return Scenario(network=network, missions=(way,), events=(event,), seed=seed)

    @property
    def route(self) -> Route:
        return route_of(*self.place)


@cache
def route_of(network: str, way: Mission) -> Route:
    return plan_route(load_network(network), way)


STORIES = {
    story.kind: story
    for story in (
        Story("dynamic_object_crossing", TOWN, 30.0),
        Story("parking_crossing_pedestrian", TOWN, 30.0),
        Story("pedestrian_group_crossing", TOWN, 60.0),
        Story("cyclist_after_turn", TOWN, 60.0),
        Story("pedestrian_after_turn", TOWN, 60.0),
        Story("crossing_bicycle_flow", TOWN, 60.0),
        Story("pedestrian_steps_out", TOWN, 40.0),
        Story("opposite_runs_red_light", TOWN, 60.0),
        Story("opposite_takes_priority", COUNTRY_END, 40.0),
        Story("left_turn_signalised", TOWN, 60.0, demands=False),
        Story("left_turn_unsignalised", COUNTRY_END, 60.0, demands=False),
        Story("right_turn_into_flow", OTHER_TOWN, 180.0, demands=False),
        Story("enter_actor_flow", COUNTRY_END, 60.0, demands=False),
        Story("merge_into_slow_traffic", EXIT, 20.0, 16.0, demands=False),
        Story("highway_exit", EXIT, 20.0, 16.0, demands=False),
        Story("interurban_left_turn", COUNTRY_END, 60.0, demands=False),
        Story("accident", HIGHWAY, 150.0, 16.0),
        Story("construction", HIGHWAY, 150.0, 16.0),
        Story("parked_obstacle", HIGHWAY, 150.0, 16.0),
        Story("accident_two_ways", COUNTRY, 150.0),
        Story("construction_two_ways", COUNTRY, 150.0),
        Story("parked_obstacle_two_ways", COUNTRY, 150.0),
        Story("vehicle_opens_door", OTHER_TOWN, 30.0),
        Story("blocked_intersection", TOWN, 60.0),
        Story("parking_exit", HIGHWAY, 0.0, 5.0),
        Story("stopped_behind_curve", TOWN, 60.0),
        Story("vehicle_appears", TOWN, 20.0),
        Story("hard_brake", COUNTRY, 100.0),
        Story("lead_vehicle_brakes", COUNTRY, 100.0),
        Story("slow_bicycles", OTHER_TOWN, 10.0),
        Story("parking_cut_in", OTHER_TOWN, 30.0),
        Story("static_cut_in", AVENUE, 100.0),
        Story("highway_cut_in", HIGHWAY, 100.0, 16.0),
        Story("oncoming_in_lane", COUNTRY, 100.0),
        Story("invading_turn", COUNTRY, 100.0),
        Story("yield_to_emergency_vehicle", HIGHWAY, 150.0, 12.0, demands=False),
    )
}


def drive(env: DrivingEnv, driver: Driver, seconds: float, until: Callable[[World], bool] | None = None) -> list[World]:
    """The worlds while a driver says at which speed [m/s], and how many lanes left of the route, to drive.

    Args:
        env: With control "lane_command" and one ego.
        driver: What it says in each world.
        seconds: How long at most.
        until: Ends the drive.
    """
    if not env.agents:
        env.reset()
    worlds = [env.world]
    while env.agents and len(worlds) <= 10 * seconds and not (until and until(worlds[-1])):
        said = driver(worlds[-1])
        speed, left = said if isinstance(said, tuple) else (said, 0.0)
        env.step({name: np.array([speed, left], np.float32) for name in env.agents})
        worlds.append(env.world)
    return worlds


def state(world: World) -> EventState:
    """Of the only event."""
    (one,) = world.events
    return one


def over(world: World) -> bool:
    return all(event.phase in OVER for event in world.events)


def rows_of(world: World, prefix: str = "event:") -> list[int]:
    """Rows in the world's actors whose names begin so."""
    return [row for row, key in enumerate(world.actors.key) if world.names[key].startswith(prefix)]


def boxes_of(world: World, prefix: str = "event:") -> FloatArray:
    return world.actors.boxes()[rows_of(world, prefix)]


def careful(cruise: float) -> Driver:
    """Stops 6 m before whatever of an event is on the route ahead."""

    def speed(world: World) -> float:
        route, progress = world.routes[0], float(world.egos.progress[0])
        gap = math.inf
        for row in rows_of(world):
            x, y = world.actors.position[row].tolist()
            s, left, _ = route.project(x, y, progress, behind=5.0, ahead=60.0)
            if abs(left) < 2.2 and s > progress + 1.0:
                gap = min(gap, s - 0.5 * float(world.actors.length[row]) - progress - 2.25)
        return min(cruise, math.sqrt(max(6.0 * (gap - 6.0), 0.0)))

    return speed


def touched(worlds: list[World], prefix: str = "event:") -> list[str]:
    """Names of those that the ego has touched, in order."""
    names = [world.name_of(contact.key) for world in worlds for contact in world.contacts]
    return [name for name in dict.fromkeys(names) if name.startswith(prefix)]
