"""The freeway in SUMO: what is read, what may be commanded, and what never happens whatever is commanded."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import libsumo
import numpy as np
import pytest

from dohyo.sumo_networks.errors import InvalidInputError, SimulationError
from dohyo.sumo_networks.freeway import (
    TICK_S,
    Day,
    FreewayScenario,
    FreewaySimulation,
    FreewayWorld,
    Incident,
    load_freeway,
)
from dohyo.sumo_networks.freeway.process import MICRO, start_sumo
from dohyo.sumo_networks.scenario import Mission, Place, Scenario
from tests.conftest import Start

QUIET = FreewayScenario(seed=5, start_s=5.6 * 3600, duration_s=300, warm_up_s=90, penetration=0.5)
DENSE = FreewayScenario(seed=5, start_s=6.9 * 3600, duration_s=900, warm_up_s=330, penetration=1.0)
Open = Callable[[FreewayScenario], FreewaySimulation]
Command = Callable[[FreewayWorld], Mapping[str, float]]


@pytest.fixture
def opened() -> Iterator[Open]:
    """Starts a scenario; whatever was started is closed afterwards."""
    running: list[FreewaySimulation] = []

    def open_(scenario: FreewayScenario) -> FreewaySimulation:
        for simulation in running:
            simulation.close()
        running.append(FreewaySimulation(scenario))
        running[-1].start()
        return running[-1]

    yield open_
    for simulation in running:
        simulation.close()


def connected(world: FreewayWorld) -> list[int]:
    return np.flatnonzero(world.connected & (world.lane >= 0)).tolist()


def run(simulation: FreewaySimulation, seconds: float, command: Command = lambda _: {}) -> list[FreewayWorld]:
    return [simulation.tick(command(simulation.world)) for _ in range(round(seconds / TICK_S))]


def test_the_world_is_what_sumo_says(opened: Open) -> None:
    world = opened(QUIET).world
    assert world.time_s == QUIET.start_s
    assert len(world.names) == len(set(world.names)) == world.departed > 40
    for row in range(0, len(world.names), 7):
        name = world.names[row]
        assert world.speed_mps[row] == libsumo.vehicle.getSpeed(name)
        assert world.connected[row] == (libsumo.vehicle.getTypeID(name).split("_")[0] == "connected")
        edge = libsumo.vehicle.getRoadID(name)
        assert (world.lane[row] < 0) == edge.startswith((":on", "on", "off")) == np.isnan(world.position_m[row])
    assert {"car", "connected", "truck"} >= {libsumo.vehicle.getTypeID(name).split("_")[0] for name in world.names}
    assert 0.1 < world.connected.mean() < 0.9
    assert np.all(world.fuel_mg_s >= 0)


def test_vehicles_go_on_and_leave(opened: Open) -> None:
    simulation = opened(QUIET)
    before = simulation.world
    worlds = run(simulation, 20)
    rows = {name: row for row, name in enumerate(worlds[-1].names)}
    same = [(old, rows[name]) for old, name in enumerate(before.names) if name in rows]
    moved = np.array([worlds[-1].position_m[new] - before.position_m[old] for old, new in same])
    assert np.nanmin(moved) > 200
    assert worlds[-1].departed > before.departed
    gone = [name for world in worlds for name in world.arrived]
    assert not set(gone) & set(worlds[-1].names)
    assert len(worlds[-1].names) == worlds[-1].departed - len(gone) - (before.departed - len(before.names))


def test_the_same_scenario_is_the_same_traffic(opened: Open) -> None:
    first = run(opened(QUIET), 15)[-1]
    again = run(opened(QUIET), 15)[-1]
    assert first.names == again.names
    assert np.array_equal(first.position_m, again.position_m, equal_nan=True)
    other = run(opened(QUIET.model_copy(update={"seed": 6})), 15)[-1]
    assert not np.array_equal(first.position_m, other.position_m, equal_nan=True)


def test_who_is_connected_changes_nothing_until_it_is_commanded(opened: Open) -> None:
    none = run(opened(QUIET.model_copy(update={"penetration": 0.0})), 15)[-1]
    half = run(opened(QUIET), 15)[-1]
    assert not none.connected.any()
    assert half.connected.any()
    assert none.names == half.names
    assert np.array_equal(none.position_m, half.position_m, equal_nan=True)


def test_a_commanded_vehicle_drives_its_speed_and_is_let_go_again(opened: Open) -> None:
    simulation = opened(QUIET)
    world = simulation.world
    one = next(row for row in connected(world) if 0 < world.position_m[row] < 3000)
    name, speed = world.names[one], world.speed_mps[one]
    worlds = run(simulation, 12, lambda _: {name: 20.0})
    assert worlds[-1].speed_mps[worlds[-1].names.index(name)] == pytest.approx(20.0, abs=0.5)
    later = run(simulation, 20)[-1]
    assert later.speed_mps[later.names.index(name)] > min(speed, 26.0) - 4.0


def test_a_commanded_acceleration_is_had(opened: Open) -> None:
    simulation = opened(QUIET)
    world = simulation.world
    name = next(world.names[row] for row in connected(world) if 0 < world.position_m[row] < 3000)
    start = world.speed_mps[world.names.index(name)]
    for _ in range(8):
        world = simulation.tick(accelerations={name: -0.8})
    assert world.speed_mps[world.names.index(name)] == pytest.approx(start - 0.8 * 8 * TICK_S, abs=0.9)


@pytest.mark.parametrize("speed", [0.0, 70.0])
def test_no_command_makes_anybody_crash(opened: Open, speed: float) -> None:
    """Everybody is told to stop dead, or to race: the car-following model keeps its distance all the same."""
    simulation = opened(DENSE.model_copy(update={"warm_up_s": 120.0}))
    world = simulation.world
    for _ in range(60):
        world = simulation.tick({world.names[row]: speed for row in connected(world)})
        assert not libsumo.simulation.getCollisions()
        gaps = world.gap_m[np.isfinite(world.gap_m)]
        assert gaps.min() > 0
    assert len(gaps) > 100


@pytest.mark.slow
def test_who_is_commanded_to_and_fro_in_dense_traffic_brakes_as_hard_as_he_must(opened: Open) -> None:
    """With SUMO's default speed mode a commanded car brakes comfortably at most, and the first is hit within 90 s."""
    simulation = opened(DENSE.model_copy(update={"warm_up_s": 480.0, "penetration": 0.3}))
    world = simulation.world
    for tick in range(240):
        speed = 45.0 if tick // 40 % 2 else 5.0
        world = simulation.tick({world.names[row]: speed for row in connected(world)})
        assert world.gap_m[np.isfinite(world.gap_m)].min() > 0
    assert len(world.names) > 700


@pytest.mark.slow
def test_a_wave_travels_upstream_at_15_to_20_km_per_hour(opened: Open) -> None:
    """All who come to one place crawl for a minute; then nobody is told anything, and the jam goes its own way."""
    simulation = opened(DENSE)

    def crawl(world: FreewayWorld) -> dict[str, float]:
        return {world.names[row]: 2.0 for row in connected(world) if 5000 < world.position_m[row] < 5250}

    run(simulation, 75, crawl)
    times, heads = [], []
    for world in run(simulation, 180)[20::20]:
        slow = (world.speed_mps < 4.0) & (world.position_m < 5250) & (world.position_m > 1000)
        assert slow.sum() >= 5, "the jam dissolved"
        times.append(world.time_s)
        heads.append(float(np.quantile(world.position_m[slow], 0.9)))  # its tail depends on who arrives
    slope, _ = np.polyfit(times, heads, 1)
    assert -21.0 < 3.6 * slope < -14.0
    assert np.corrcoef(times, heads)[0, 1] < -0.98


def test_an_incident_blocks_its_lane(opened: Open) -> None:
    incident = Incident(time_s=5.6 * 3600, duration_s=600, position_m=2500.0, lane=0)
    simulation = opened(QUIET.model_copy(update={"day": Day(incidents=(incident,)), "warm_up_s": 240.0}))
    world = run(simulation, 60)[-1]
    wreck = world.names.index("wreck0")
    assert world.speed_mps[wreck] == 0
    assert world.lane[wreck] == 0
    assert world.position_m[wreck] == pytest.approx(2500, abs=40)  # people do not stop to the metre


def test_an_incident_inside_a_junction_blocks_the_lane_before_it(opened: Open) -> None:
    """As a drawn one may be, on 20 of 11,400 m: SUMO ends where a stop is beyond its lane, once its car departs."""
    road = load_freeway()
    junction = road.tracks["m01_0"].start_m + float(road.network.lanes.length[road.network.lane_index["m01_0"]])
    incident = Incident(time_s=5.6 * 3600, duration_s=600, position_m=junction + 0.2, lane=1)
    quiet = Day(demand=0.05, incidents=(incident,))
    simulation = opened(QUIET.model_copy(update={"day": quiet, "warm_up_s": 120.0}))
    world = run(simulation, 60)[-1]
    wreck = world.names.index("wreck0")
    assert world.speed_mps[wreck] == 0
    assert world.lane[wreck] == 1
    assert world.position_m[wreck] == pytest.approx(junction, abs=40)


def test_the_a10_is_a_freeway_too(opened: Open) -> None:
    simulation = opened(QUIET.model_copy(update={"network": "a10"}))
    world = run(simulation, 30)[-1]
    assert simulation.road.segments == 4
    assert set(range(4)) <= set(world.segment.tolist())
    assert world.lane.max() <= 3
    assert np.nanmax(world.position_m) < simulation.road.end_m


# What is refused


def test_commands_that_cannot_be_are_refused(opened: Open) -> None:
    simulation = opened(QUIET)
    world = simulation.world
    linked = world.names[connected(world)[0]]
    human = world.names[int(np.flatnonzero(~world.connected)[0])]
    with pytest.raises(InvalidInputError, match="vehicle 'nobody' is not on the freeway"):
        simulation.tick({"nobody": 10.0})
    with pytest.raises(InvalidInputError, match="is not connected"):
        simulation.tick({human: 10.0})
    for wrong in (-1.0, float("nan"), float("inf")):
        with pytest.raises(InvalidInputError, match="expected a speed of 0 m/s or more"):
            simulation.tick({linked: wrong})
    with pytest.raises(InvalidInputError, match="expected a finite acceleration"):
        simulation.tick(accelerations={linked: float("nan")})
    with pytest.raises(InvalidInputError, match="is given a speed and an acceleration"):
        simulation.tick({linked: 10.0}, {linked: 0.0})
    assert simulation.tick().time_s == world.time_s + TICK_S  # nothing of it was done


def test_a_process_has_room_for_one_and_it_must_be_started(opened: Open) -> None:
    with pytest.raises(SimulationError, match="start it first"):
        FreewaySimulation(QUIET).tick()
    opened(QUIET)
    with pytest.raises(SimulationError, match="another simulation of this process is still open"):
        FreewaySimulation(QUIET).start()


def test_a_city_cannot_be_started_beside_it(opened: Open, start: Start) -> None:
    simulation = opened(QUIET)
    mission = Mission(
        start=Place(lane="737320747#3_2", position_m=8.0), goal=Place(lane="726514449_2", position_m=-5.0)
    )
    with pytest.raises(SimulationError, match="another simulation of this process is still open"):
        start(Scenario(network="ingolstadt", missions=(mission,)))
    assert simulation.tick().time_s == QUIET.start_s + TICK_S


def test_what_sumo_cannot_load_leaves_nothing_open(tmp_path: Path) -> None:
    (tmp_path / "bad.xml").write_text("<rou")
    with pytest.raises(SimulationError, match="SUMO could not load the freeway"):
        start_sumo(load_freeway().network.path, [tmp_path / "bad.xml"], 0.0, 1, MICRO)
    assert not libsumo.isLoaded()


def test_an_incident_beside_the_road_is_refused_before_sumo_starts() -> None:
    incident = Incident(time_s=6 * 3600, duration_s=60, position_m=99_999, lane=0)
    with pytest.raises(InvalidInputError, match="incident at 99999 m"):
        FreewaySimulation(QUIET.model_copy(update={"day": Day(incidents=(incident,))})).start()
    assert not libsumo.isLoaded()


def test_an_incident_that_would_be_left_out_is_refused_before_sumo_starts() -> None:
    incident = Incident(time_s=QUIET.start_s + 30, duration_s=600, position_m=9000.0, lane=0)
    with pytest.raises(InvalidInputError, match=r"a warm-up of at least .* s, got 90 s"):
        FreewaySimulation(QUIET.model_copy(update={"day": Day(incidents=(incident,))})).start()
    assert not libsumo.isLoaded()
