"""Draws `val14` and `val14-train`: python -m dohyo.evaluation.authoring.draw_val14 NAME [--pin].

For each seed the traffic of a network warms up for 30 s. Every car in it is a candidate: the ego replaces the car, with
its speed and a route on which a scenario of some type is likely. The reference then drives 15 s in live traffic. The
candidate is kept if this run passes the test of that type in `dohyo.evaluation.authoring.scenario_types`. Types that
are too rare in traffic alone get a scripted event on the way, and have to pass the same test.

The benchmarks share no places and no seeds: a hash of its name assigns an edge to one of them. Scenarios that a file
has are kept, and only missing ones are drawn. After a change of the reference or the simulation, `--pin` keeps all
missions, drives the reference again, and writes its logs and progress.
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np

from dohyo.evaluation.authoring.scenario_types import TYPES
from dohyo.evaluation.authoring.val14_search import (
    ALWAYS_STAGED,
    DURATION_S,
    STAGED,
    TRAFFIC,
    belongs,
    cars,
    confirm,
    excerpt_of,
    propose,
    run_of,
    scenario_of,
    take_snapshot,
)
from dohyo.evaluation.benchmarks.benchmark import Benchmark, Cell, ScriptedMission, load_benchmark
from dohyo.evaluation.benchmarks.documents import BENCHMARKS
from dohyo.evaluation.benchmarks.headline import Headline
from dohyo.evaluation.benchmarks.traffic_logs import drive_reference
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.processes import worker_pool

SEARCHED = ("district", "ingolstadt", "braunschweig", "adlershof")  # the fastest to simulate first
QUARTERS_UNTIL = 1  # number of seeds in which each network gives only its quarter
TRIES = 3  # largest number of candidates per network, seed and type
LONGEST_SEARCH = 60  # largest number of seeds
SAME_PLACE_FROM = 6  # number of seeds after which a type may come twice on one edge, at different times
METRIC = "closed-loop score: NC x DAC x DDC x MP x (5 EP + 5 TTC + 4 SL + 2 C) / 16, mean over drives (nuPlan)"

Found = tuple[str, str, ScriptedMission]
"""Type, network and mission of one scenario."""


def draw(
    name: str, per_type: int, first_seed: int, train: bool, reference_agent: str, there: Sequence[Found] = ()
) -> Iterator[Found]:
    """Searches the missing scenarios; yields type, network and mission of each when it is found.

    Args:
        name: Name of the scenarios during the search.
        per_type: Number of scenarios of each type.
        first_seed: First seed of the traffic.
        train: Whether to use the edges for training instead of those for the benchmark.
        reference_agent: "module:Class" of the reference agent.
        there: Scenarios that were found before.

    Raises:
        InvalidInputError: Too few scenarios of some type were found.
    """
    found = Counter(kind for kind, _, _ in there)
    local = Counter((kind, network_name) for kind, network_name, _ in there)
    used = {(kind, network_name, mission.start.lane.rpartition("_")[0]) for kind, network_name, mission in there}
    moments = {(mission.excerpt.seed, mission.start) for _, _, mission in there if mission.excerpt}
    # Seeds that were searched before would fail again.
    begin = max((seed - first_seed + 1 for seed, _ in moments), default=0)
    for number in range(begin, begin + LONGEST_SEARCH):
        # Each network gives a quarter first; the other networks replace what it lacks.
        share = per_type if number >= QUARTERS_UNTIL else math.ceil(per_type / len(TRAFFIC))
        for network_name in SEARCHED:
            wanted = [one for one in TYPES if found[one] < per_type and local[one, network_name] < share]
            if not wanted:
                continue
            snapshot = take_snapshot(network_name, first_seed + number)
            candidates = [one for one in cars(snapshot) if belongs(snapshot.network, one.lane, train)]
            for kind in wanted:
                rng = np.random.default_rng([first_seed, number, list(TYPES).index(kind)])
                staged = kind in ALWAYS_STAGED or (kind in STAGED and number >= 2)
                tries = 0
                for i in rng.permutation(len(candidates)):
                    edge = snapshot.network.edge_id(candidates[i].lane)
                    if tries >= TRIES or (number < SAME_PLACE_FROM and (kind, network_name, edge) in used):
                        continue
                    mission = propose(kind, snapshot, candidates[i], rng, staged)
                    if mission is None or (snapshot.seed, mission.start) in moments:
                        continue
                    tries += 1
                    kept, types = confirm(kind, snapshot, mission, reference_agent)
                    if kept is not None:
                        # A run that is not of the intended type may be of another type that is still missing.
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


def lines(name: str, reference_agent: str, found: Sequence[Found]) -> Iterator[str]:
    """Lines of a benchmark's file."""
    what = "train a planner on" if name.endswith("train") else "the 14 scenario types of nuPlan's challenge"
    yield f'name = "{name}"'
    yield f'description = "{len(found)} scenarios of 15 s: {what}; all others replay a recorded run"'
    yield f'headline = "{Headline.CLOSED_LOOP}"'
    yield f'metric = "{METRIC}"'
    yield "seeds = [0]"
    yield f"duration_s = {DURATION_S}"
    yield "replay = true"
    yield f'reference_agent = "{reference_agent}"'
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


def pinned(benchmark: Benchmark, reference_agent: str, workers: int) -> Iterator[Found]:
    """The missions of a benchmark, with new drives of the reference agent.

    A run that is no longer of its type is reported and kept: its place in the list is part of the benchmark.
    """
    todo = [(cell, mission) for cell in benchmark.cells for mission in benchmark.missions[cell.missions]]
    with worker_pool(workers, _pin) as pool:
        yield from pool.map(partial(_pin, reference_agent), todo)


def _pin(reference_agent: str, one: tuple[Cell, ScriptedMission]) -> Found:
    cell, mission = one
    kind = cell.name.partition(".")[0]
    assert mission.excerpt is not None
    warm = cell.traffic.model_copy(update={"warm_up_s": mission.excerpt.warm_up_s})
    scenario = scenario_of(cell.model_copy(update={"traffic": warm}), mission, mission.excerpt.seed)
    reference = drive_reference(scenario, reference_agent)
    if not TYPES[kind](run_of(scenario, reference)):
        print(f"{cell.name} {mission.name}: the reference's run is no longer of this type", flush=True)
    return kind, cell.network, mission.model_copy(update={"excerpt": excerpt_of(mission.excerpt.seed, reference)})


VARIANTS = {
    "val14": partial(draw, "val14", 20, 1000, False),
    "val14-train": partial(draw, "val14-train", 5, 5000, True),
}


def missions_of(benchmark: Benchmark) -> list[Found]:
    """Type, network and mission of every scenario in a benchmark's file."""
    return [
        (cell.name.partition(".")[0], cell.network, mission)
        for cell in benchmark.cells
        for mission in benchmark.missions[cell.missions]
    ]


def write(name: str, reference_agent: str, pin: bool, workers: int) -> None:
    """Draws the missing scenarios of a benchmark's file, or pins those in it; an interruption loses no finished one."""
    file = BENCHMARKS / f"{name}.toml"
    found = missions_of(load_benchmark(name)) if file.exists() and not pin else []
    draws = (
        pinned(load_benchmark(name), reference_agent, workers)
        if pin
        else VARIANTS[name](reference_agent=reference_agent, there=tuple(found))
    )
    for one in draws:
        found.append(one)
        if not pin:
            file.write_text("\n".join(lines(name, reference_agent, found)) + "\n")
    file.write_text("\n".join(lines(name, reference_agent, found)) + "\n")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Draws a benchmark of recorded scenarios.")
    parser.add_argument("name", choices=VARIANTS)
    parser.add_argument("--reference", required=True, help="module:Class of the reference agent")
    parser.add_argument("--pin", action="store_true", help="keep the missions, drive the reference again")
    parser.add_argument("--workers", type=int, default=1, help="number of processes for --pin")
    arguments = parser.parse_args()
    write(arguments.name, arguments.reference, arguments.pin, arguments.workers)
