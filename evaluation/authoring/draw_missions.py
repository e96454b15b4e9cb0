"""Draws the missions of `nocrash` and `corl2017`: python -m dohyo.evaluation.authoring.draw_missions.

The original start and goal points belong to CARLA's towns. Here they are drawn at random, from fixed seeds, among the
lanes of dohyo's towns: no U-turns, a given range of lengths, and for CoRL2017 a given number of turns. The files are
committed, so a change of a network does not silently move the missions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from dohyo.evaluation.benchmarks.documents import BENCHMARKS
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.routes.command import Command
from dohyo.sumo_networks.routes.route import Route
from dohyo.sumo_networks.routes.routing import plan_route
from dohyo.sumo_networks.scenario import Mission, Place

COUNT = 25
ATTEMPTS = 100_000
TRAIN_CONDITIONS = ["clear", "wet", "heavy-rain", "sunset"]
TEST_CONDITIONS = ["drizzle-sunset", "wet-sunset"]
TOWNS = {
    "town-train": {"empty": (0, 0), "regular": (20, 50), "dense": (100, 250)},
    "town-test": {"empty": (0, 0), "regular": (15, 50), "dense": (70, 150)},
}
LENGTHS_M = {"town-train": (400.0, 1400.0), "town-test": (250.0, 900.0)}


def draw(network: RoadNetwork, seed: int, accepts: Callable[[Route], bool]) -> list[Mission]:
    """25 different missions whose routes are accepted.

    Raises:
        InvalidInputError: The network has fewer such routes.
    """
    rng, lanes = np.random.default_rng(seed), network.lanes
    long = lanes.longer_than(40.0)
    found: dict[tuple[int, int], Mission] = {}
    for _ in range(ATTEMPTS):
        a, b = (int(lane) for lane in rng.choice(long, 2, replace=False))
        start = Place(lane=str(lanes.ids[a]), position_m=round(float(rng.uniform(8.0, lanes.length[a] - 20.0)), 1))
        goal = Place(lane=str(lanes.ids[b]), position_m=round(float(rng.uniform(15.0, lanes.length[b] - 15.0)), 1))
        mission = Mission(name=f"m{len(found) + 1:02d}", start=start, goal=goal)
        if (a, b) not in found and _suits(network, mission, accepts):
            found[(a, b)] = mission
        if len(found) == COUNT:
            return list(found.values())
    raise InvalidInputError(f"network '{network.name}' has only {len(found)} such missions, not {COUNT}")


def _suits(network: RoadNetwork, mission: Mission, accepts: Callable[[Route], bool]) -> bool:
    try:
        route = plan_route(network, mission)
    except InvalidInputError:
        return False
    u_turn = any(network.connections.direction[passage.connection] == "t" for passage in route.passages)
    return not u_turn and accepts(route)


def turns(route: Route) -> int:
    """Number of junctions at which a route turns."""
    return sum(passage.command is not Command.STRAIGHT for passage in route.passages)


def nocrash() -> Iterator[str]:
    """Lines of nocrash.toml."""
    yield from (
        'name = "nocrash"',
        'description = "NoCrash on our towns: 25 missions x 3 traffic levels x train and test conditions x 2 towns"',
        'headline = "nocrash_success"',
        'metric = "NoCrash success: share of episodes that reach the goal without a collision, in the time that the '
        "route takes at 5 km/h and 20 s more (original: at 10 km/h); conditions are dealt out to the missions in turn "
        '(original: each mission under every one)"',
        'rules = "2.0"',
        "stop_on_collision = true",
        "seeds = [0, 1, 2]",
        # As in the code of the original. Papers say 10 km/h, which is the mean speed of dense traffic itself.
        "time_limit = { speed_kmh = 5.0, extra_s = 20.0 }",
    )
    for town, levels in TOWNS.items():
        for level, traffic in levels.items():
            for group, conditions in (("train", TRAIN_CONDITIONS), ("test", TEST_CONDITIONS)):
                yield from _cell(f"{town}.{level}.{group}", town, town, traffic, conditions)
    for number, town in enumerate(TOWNS):
        low, high = LENGTHS_M[town]
        yield from _missions(town, draw(load_network(town), 11 + number, lambda r: low <= r.length <= high))  # noqa: B023


def corl2017() -> Iterator[str]:
    """Lines of corl2017.toml."""
    yield from (
        'name = "corl2017"',
        'description = "CoRL2017 on our towns: straight, one turn, navigation, navigation among others; 25 each"',
        'headline = "success"',
        'metric = "success: share of episodes that reach the goal in time, collisions notwithstanding"',
        'rules = "2.0"',
        "seeds = [0]",
        "time_limit = { speed_kmh = 10.0, extra_s = 10.0 }",
    )
    tasks = {"straight": "straight", "one-turn": "one-turn", "navigation": "navigation", "dynamic": "navigation"}
    for town, levels in TOWNS.items():
        for task, missions in tasks.items():
            traffic = levels["regular"] if task == "dynamic" else (0, 0)
            for group, conditions in (("train", TRAIN_CONDITIONS), ("test", TEST_CONDITIONS)):
                yield from _cell(f"{town}.{task}.{group}", town, f"{town}-{missions}", traffic, conditions)
    for number, town in enumerate(TOWNS):
        network, (low, high) = load_network(town), LENGTHS_M[town]
        kinds: dict[str, Callable[[Route], bool]] = {
            "straight": lambda r: turns(r) == 0 and r.length >= 60.0,
            "one-turn": lambda r: turns(r) == 1 and r.length >= 60.0,
            "navigation": lambda r: low <= r.length <= high and turns(r) >= 2,  # noqa: B023
        }
        for offset, (kind, accepts) in enumerate(kinds.items()):
            yield from _missions(f"{town}-{kind}", draw(network, 21 + 10 * number + offset, accepts))


def _cell(name: str, network: str, missions: str, traffic: tuple[int, int], conditions: list[str]) -> Iterator[str]:
    vehicles, pedestrians = traffic
    yield from (
        "",
        "[[cells]]",
        f'name = "{name}"',
        f'network = "{network}"',
        f'missions = "{missions}"',
        f"traffic = {{ vehicles = {vehicles}, pedestrians = {pedestrians}, warm_up_s = {30.0 if vehicles else 0.0} }}",
        "conditions = [" + ", ".join(f'"{one}"' for one in conditions) + "]",
    )


def _missions(name: str, missions: list[Mission]) -> Iterator[str]:
    for mission in missions:
        yield from (
            "",
            f"[[missions.{name}]]",
            f'name = "{mission.name}"',
            f'start = {{ lane = "{mission.start.lane}", position_m = {mission.start.position_m} }}',
            f'goal = {{ lane = "{mission.goal.lane}", position_m = {mission.goal.position_m} }}',
        )


if __name__ == "__main__":
    for name, lines in {"nocrash": nocrash(), "corl2017": corl2017()}.items():
        (BENCHMARKS / f"{name}.toml").write_text("\n".join(lines) + "\n")
