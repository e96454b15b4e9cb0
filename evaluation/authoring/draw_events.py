"""Draws `obstacles`, `precrash`, `endurance` and the leaderboards: python -m dohyo.evaluation.authoring.draw_events.

As in draw_missions.py, places are drawn at random from fixed seeds and the files are committed. A scripted event is
kept where it fits. The events of the leaderboards are placed at every evaluation, from its seed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from pydantic import TypeAdapter

from dohyo.evaluation.authoring.draw_missions import TEST_CONDITIONS, TRAIN_CONDITIONS
from dohyo.evaluation.benchmarks.documents import BENCHMARKS
from dohyo.evaluation.benchmarks.headline import Headline
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.events import Event
from dohyo.sumo_networks.events.placement import check_placement
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.routes.route import Route
from dohyo.sumo_networks.routes.routing import plan_route
from dohyo.sumo_networks.scenario import Mission, Place

Value = str | float | int
ATTEMPTS = 20_000
OBSTACLE_AT_M = 25.0
PRECRASH_AT_M = (40.0, 120.0)

VEHICLES: Mapping[str, tuple[str, tuple[tuple[float, float], ...]]] = {
    "scooter": ("car", ((1.7, 0.7), (1.9, 0.8))),
    "motorcycle": ("car", ((2.1, 0.8), (2.3, 0.9), (2.5, 1.0))),
    "small car": ("car", ((2.7, 1.6), (3.1, 1.6), (3.5, 1.65), (3.7, 1.7))),
    "car": ("car", ((4.0, 1.75), (4.3, 1.8), (4.5, 1.8), (4.7, 1.85), (4.9, 1.9), (5.1, 1.95))),
    "van": ("van", ((4.8, 1.9), (5.3, 2.0), (5.9, 2.05), (6.5, 2.1))),
    "truck": ("truck", ((6.8, 2.3), (7.5, 2.4), (8.5, 2.5), (9.5, 2.5), (11.0, 2.55))),
    "bus": ("bus", ((9.0, 2.4), (12.0, 2.55), (13.5, 2.55))),
}
"""27 vehicles: SUMO's class, length [m], width [m]."""

WALKERS = tuple(product((0.35, 0.5), (0.8, 0.9, 1.0, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6, 1.8, 2.0, 2.5, 3.0)))
"""26 pedestrians: width of shoulders [m], pace [m/s]; children and adults, from a shuffle to a run."""

PRECRASH = {
    "lead_vehicle_brakes": ("town-train", "town-test", "district"),
    "static_cut_in": ("district",),
    "dynamic_object_crossing": ("town-train", "town-test", "district"),
    "opposite_runs_red_light": ("town-train", "town-test", "district"),
    "left_turn_unsignalised": ("district",),
    "oncoming_in_lane": ("town-train", "town-test", "district"),
    "stopped_behind_curve": ("town-train", "town-test", "district"),
}
"""Kinds of event and the places where they are possible. Source: NHTSA's pre-crash scenarios, as Albilani uses them."""


@dataclass(frozen=True)
class Drawn:
    """A mission and its event, as written in a file."""

    mission: Mission
    event: Mapping[str, Value]


class Draw:
    """Draws missions on one network."""

    def __init__(self, name: str, seed: int) -> None:
        self.network: RoadNetwork = load_network(name)
        self.rng = np.random.default_rng(seed)
        self._lanes = self.network.lanes.longer_than(40.0)

    def mission(self, name: str, low: float, high: float, stops: int = 0) -> tuple[Mission, Route]:
        """A mission through a given number of random edges, whose route has a length within a range [m]."""
        for _ in range(ATTEMPTS):
            start, goal = (self._place() for _ in range(2))
            via = tuple(self.network.edge_id(int(lane)) for lane in self.rng.choice(self._lanes, stops))
            mission = Mission(name=name, start=start, goal=goal, via=via)
            try:
                route = plan_route(self.network, mission)
            except InvalidInputError:
                continue
            turns_back = any(self.network.connections.direction[p.connection] == "t" for p in route.passages)
            if low <= route.length <= high and not turns_back:
                return mission, route
        raise InvalidInputError(f"network '{self.network.name}' has no route of {low:.0f} to {high:.0f} m")

    def scripted(self, name: str, low: float, high: float, event: Mapping[str, Value]) -> Drawn:
        """A mission on whose route an event fits."""
        for _ in range(ATTEMPTS):
            mission, route = self.mission(name, low, high)
            at = event.get("at_m", round(float(self.rng.uniform(*PRECRASH_AT_M)), 1))
            placed = {**event, "at_m": at}
            if fits(placed, self.network, route):
                return Drawn(mission, placed)
        raise InvalidInputError(f"network '{self.network.name}' has no place for event {dict(event)}")

    def _place(self) -> Place:
        lanes, lane = self.network.lanes, int(self.rng.choice(self._lanes))
        at = round(float(self.rng.uniform(8.0, lanes.length[lane] - 15.0)), 1)
        return Place(lane=str(lanes.ids[lane]), position_m=at)


def fits(event: Mapping[str, Value], network: RoadNetwork, route: Route) -> bool:
    """Whether an event is possible on a route."""
    one: Event = TypeAdapter[Event](Event).validate_python({"name": "event", **event})
    try:
        check_placement(one, "ego", network, route)
    except InvalidInputError:
        return False
    return True


def obstacles() -> Iterator[str]:
    """Lines of obstacles.toml: each of 27 vehicles and 26 pedestrians three times, distributed over both towns."""
    yield from _head(
        "obstacles",
        "An empty road, and something appears 30 m ahead, stays a while, and goes: stop, and drive on",
        Headline.NOCRASH_SUCCESS,
        "NoCrash success: share of episodes that stop for it, drive on and reach the goal in time",
        "stop_on_collision = true",
        "seeds = [0]",
        "time_limit = { speed_kmh = 5.0, extra_s = 20.0 }",
    )
    vehicles: list[Mapping[str, Value]] = [
        {"kind": "vehicle_appears", "actor": actor, "length_m": length, "width_m": width, "stay_s": 10.0}
        for actor, sizes in VEHICLES.values()
        for length, width in sizes
    ]
    people: list[Mapping[str, Value]] = [
        {"kind": "pedestrian_steps_out", "width_m": width, "speed_mps": pace} for width, pace in WALKERS
    ]
    towns = ("town-train", "town-test")
    for what, events in {"vehicle": vehicles, "pedestrian": people}.items():
        for number, town in enumerate(towns):
            yield from _cell(f"{what}.{town}", town, f"{what}-{town}", TRAIN_CONDITIONS)
            draw = Draw(town, 31 + number)
            for i, event in enumerate(3 * events):
                if i % 2 == number:
                    placed = {**event, "at_m": OBSTACLE_AT_M}
                    yield from _mission(f"{what}-{town}", draw.scripted(f"m{i + 1:02d}", 110.0, 260.0, placed))


def precrash() -> Iterator[str]:
    """Lines of precrash.toml: twelve places for each kind of pre-crash event."""
    yield from _head(
        "precrash",
        "Seven kinds of accidents about to happen, twelve places each, in light traffic",
        Headline.NOCRASH_SUCCESS,
        "NoCrash success: share of episodes that reach the goal in time without a collision",
        "stop_on_collision = true",
        "seeds = [0, 1, 2]",
        "time_limit = { speed_kmh = 5.0, extra_s = 60.0 }",
    )
    for number, (kind, networks) in enumerate(PRECRASH.items()):
        for i, network in enumerate(networks):
            name = f"{kind.replace('_', '-')}-{network}"
            yield from _cell(f"{kind.replace('_', '-')}.{network}", network, name, TEST_CONDITIONS, vehicles=8)
            draw = Draw(network, 51 + 10 * number + i)
            for j in range(12 // len(networks)):
                yield from _mission(name, draw.scripted(f"m{j + 1:02d}", 200.0, 500.0, {"kind": kind}))


def leaderboard(name: str, routes: Mapping[str, int], conditions: Sequence[str], seed: int) -> Iterator[str]:
    """Lines of a leaderboard: a number of routes of 1 to 3 km per network, with scripted events on the way."""
    yield from _head(
        name,
        f"{sum(routes.values())} routes of 1 to 3 km in city traffic, with a scripted event every 200 to 300 m",
        Headline.DRIVING_SCORE,
        "driving score: route completion times infraction penalty",
        "seeds = [0]",
    )
    vehicles = {"adlershof": 300, "district": 60}
    for i, (network, count) in enumerate(routes.items()):
        events = 'events = "auto"'
        yield from _cell(network, network, network, conditions, vehicles[network], events)
        draw = Draw(network, seed + i)
        for j in range(count):
            mission, _ = draw.mission(f"r{j + 1:02d}", 1000.0, 3000.0, stops=0 if network == "adlershof" else 2)
            yield from _mission(network, Drawn(mission, {}))


def endurance() -> Iterator[str]:
    """Lines of endurance.toml: routes of at least 2500 m."""
    yield from _head(
        "endurance",
        "Ten long routes through each town in regular traffic: how far without a collision?",
        Headline.DROVE_2500M,
        "2500 m: share of episodes that drive 2500 m before any collision",
        "stop_on_collision = true",
        "seeds = [0, 1, 2]",
        "time_limit = { speed_kmh = 5.0, extra_s = 20.0 }",
    )
    for number, (town, vehicles) in enumerate({"town-train": 20, "town-test": 15}.items()):
        yield from _cell(town, town, town, TRAIN_CONDITIONS + TEST_CONDITIONS, vehicles)
        draw = Draw(town, 41 + number)
        for j in range(10):
            mission, _ = draw.mission(f"m{j + 1:02d}", 2510.0, 3200.0, stops=7)
            yield from _mission(town, Drawn(mission, {}))


def _head(name: str, description: str, headline: Headline, metric: str, *more: str) -> Iterator[str]:
    yield from (
        f'name = "{name}"',
        f'description = "{description}"',
        f'headline = "{headline}"',
        f'metric = "{metric}"',
        'rules = "2.0"',
        *more,
    )


def _cell(
    name: str, network: str, missions: str, conditions: Sequence[str], vehicles: int = 0, *more: str
) -> Iterator[str]:
    traffic = f"vehicles = {vehicles}, bicycles = {vehicles // 10}, pedestrians = {vehicles // 2}"
    yield from (
        "",
        "[[cells]]",
        f'name = "{name}"',
        f'network = "{network}"',
        f'missions = "{missions}"',
        f"traffic = {{ {traffic}, warm_up_s = {30.0 if vehicles else 0.0} }}",
        "conditions = [" + ", ".join(f'"{one}"' for one in conditions) + "]",
        *more,
    )


def _mission(missions: str, drawn: Drawn) -> Iterator[str]:
    mission, event = drawn.mission, drawn.event
    yield from (
        "",
        f"[[missions.{missions}]]",
        f'name = "{mission.name}"',
        f'start = {{ lane = "{mission.start.lane}", position_m = {mission.start.position_m} }}',
        f'goal = {{ lane = "{mission.goal.lane}", position_m = {mission.goal.position_m} }}',
    )
    if mission.via:
        yield "via = [" + ", ".join(f'"{edge}"' for edge in mission.via) + "]"
    if event:
        fields = {"name": "event", **event}
        yield "events = [{ " + ", ".join(f"{key} = {_toml(value)}" for key, value in fields.items()) + " }]"


def _toml(value: Value) -> str:
    return f'"{value}"' if isinstance(value, str) else str(value)


if __name__ == "__main__":
    files = {
        "endurance": endurance(),
        "obstacles": obstacles(),
        "precrash": precrash(),
        "leaderboard": leaderboard("leaderboard", {"adlershof": 12, "district": 8}, TEST_CONDITIONS, 71),
        "leaderboard-train": leaderboard("leaderboard-train", {"adlershof": 60, "district": 30}, TRAIN_CONDITIONS, 81),
    }
    for file, lines in files.items():
        (BENCHMARKS / f"{file}.toml").write_text("\n".join(lines) + "\n")
