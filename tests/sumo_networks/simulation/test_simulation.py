from __future__ import annotations

import math
import pickle
import subprocess
import sys
from collections import Counter
from copy import deepcopy
from pathlib import Path

import libsumo
import numpy as np
import pytest

from dohyo.sumo_networks.actors.names import Role, role_of
from dohyo.sumo_networks.ego.dynamics import VehicleParameters, Vehicles
from dohyo.sumo_networks.errors import InvalidInputError, SimulationError
from dohyo.sumo_networks.events.kinds.emergency import YieldToEmergencyVehicle
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.scenario import Mission, Obstacle, Place, Scenario, Traffic
from dohyo.sumo_networks.simulation import START_CLEARANCE_M, Simulation, plan_scenario
from dohyo.sumo_networks.simulation.sumo_traffic import arrived
from dohyo.sumo_networks.simulation.traffic_log import LogRecorder
from dohyo.sumo_networks.units import TICK_S
from dohyo.sumo_networks.world import ActorKind, LightState, World
from tests.conftest import Start
from tests.sumo_networks.simulation.drives import (
    BRAKE,
    busy_road,
    driven,
    fingerprint,
    in_ingolstadt,
    on,
    standing_at,
)
from tests.worlds import LANE_M, Scene, _build, crossing_for_pedestrians, lit_crossing, straight_road

FULL_THROTTLE = (4.0, 0.0)


def touched(worlds: list[World]) -> Counter[ActorKind]:
    """How many different actors the egos touched, by kind."""
    return Counter(kind for _, kind in {(c.key, c.kind) for world in worlds for c in world.contacts})


def gaps_behind(world: World) -> np.ndarray:
    """Bumper to bumper, m, of those who follow the ego in its lane on the straight road."""
    actors, ego = world.actors, world.egos.position[0]
    same = np.abs(actors.position[:, 1] - ego[1]) < 1.0
    gap = ego[0] - actors.position[:, 0] - (actors.length + world.egos.length[0]) / 2
    return np.asarray(gap[same & (gap > 0)])


# Honesty: SUMO's own safety must not hide what an agent does wrong


def test_an_ego_at_constant_throttle_crashes_into_others(start: Start) -> None:
    simulation, _ = start(busy_road())
    worlds = driven(simulation, FULL_THROTTLE, 15.0)
    assert touched(worlds)[ActorKind.CAR] >= 1
    assert worlds[-1].egos.speed[0] > 20.0, "a crash does not stop it"


def test_nothing_in_sumo_changes_how_the_ego_drives(start: Start) -> None:
    simulation, world = start(busy_road())
    alone = Vehicles(VehicleParameters(), 1)
    alone.place(0, *world.egos.position[0].tolist(), float(world.egos.heading[0]))
    rng = np.random.default_rng(0)
    for _ in range(100):
        commands = rng.uniform((-2.0, -0.03), (4.0, 0.03), (1, 2))
        world = simulation.tick(commands)
        alone.advance(commands, TICK_S)
        np.testing.assert_array_equal(world.egos.position, alone.centres())
        assert world.egos.speed[0] == alone.states[0, 3]
        assert world.egos.heading[0] == alone.states[0, 2]


def test_an_ego_runs_a_red_light_if_it_wants_to(start: Start) -> None:
    scene = lit_crossing()
    mission = Mission(start=Place(lane="w_c_0", position_m=150.0), goal=Place(lane="c_e_0", position_m=-1.0))
    simulation, world = start(on(scene, mission))
    (passage,) = simulation.plan.routes[0].passages
    while world.signals[passage.signal] != LightState.RED:
        world = simulation.tick(BRAKE[None])
        assert world.time < 120
    line = scene.stop_line("w_c_0")
    before, worlds = world, driven(simulation, FULL_THROTTLE, 6.0)
    after = next(w for w in worlds if w.egos.position[0, 0] + 2.25 > line)
    assert after.signals[passage.signal] == LightState.RED
    free = Vehicles(VehicleParameters(), 1)
    free.advance(np.array([FULL_THROTTLE]), round(after.time - before.time, 1))
    assert after.egos.speed[0] == pytest.approx(free.states[0, 3])
    assert worlds[-1].egos.position[0, 0] > line + 20


def test_two_egos_that_meet_touch_each_other(start: Start) -> None:
    parked, driver = standing_at(60.0, name="parked"), standing_at(20.0, name="driver")
    simulation, world = start(on(straight_road(), parked, driver))
    commands, hits = np.array([BRAKE, FULL_THROTTLE]), []
    while not hits and world.time < 10:
        world = simulation.tick(commands)
        hits = [(c.ego, c.key, c.kind) for c in world.contacts]
    assert hits == [(0, -2, ActorKind.EGO), (1, -1, ActorKind.EGO)]
    assert world.name_of(-2) == "driver"
    assert np.diff(world.egos.position[:, 0]) == pytest.approx(-4.5, abs=1.5)


def test_an_obstacle_is_hit(start: Start) -> None:
    obstacle = Obstacle(x_m=40.0, y_m=-4.8, heading_rad=0.3, length_m=3.0, width_m=1.0)
    simulation, world = start(on(straight_road(), standing_at(20.0), obstacles=(obstacle,)))
    assert world.actors.kind.tolist() == [ActorKind.STATIC]
    assert world.actors.boxes()[0].tolist() == [40.0, -4.8, 0.3, 3.0, 1.0]
    assert world.name_of(int(world.actors.key[0])) == "obstacle-0"
    worlds = driven(simulation, FULL_THROTTLE, 5.0)
    assert touched(worlds) == {ActorKind.STATIC: 1}
    first = next(w for w in worlds if w.contacts)
    assert first.egos.position[0, 0] + 2.25 == pytest.approx(38.5, abs=0.8)
    assert not worlds[-1].contacts


# The others see the ego


def test_others_brake_for_a_standing_ego(start: Start) -> None:
    simulation, _ = start(busy_road())
    worlds = driven(simulation, BRAKE, 30.0)
    assert not any(world.contacts for world in worlds)
    assert min(gaps_behind(world).min(initial=math.inf) for world in worlds) < 30.0, "nobody ever came"


def test_a_retired_ego_frees_its_place(start: Start) -> None:
    simulation, world = start(busy_road(standing_at(500.0), standing_at(520.0, "e_w_1", "watcher")))
    x, y = world.egos.position[0]

    def reached(worlds: list[World]) -> bool:
        offsets = [world.actors.position - (x, y) for world in worlds]
        return any((np.abs(offset) < (2.0, 0.5)).all(axis=1).any() for offset in offsets)

    assert not reached(driven(simulation, BRAKE, 20.0))
    simulation.retire(0)
    worlds = driven(simulation, BRAKE, 25.0)
    assert [name for name in libsumo.vehicle.getIDList() if name.startswith("ego")] == ["ego:watcher"]
    assert reached(worlds), "its place is free again"
    assert not worlds[-1].egos.active[0]
    assert worlds[-1].egos.active[1]
    assert worlds[-1].egos.position[0] == pytest.approx([x, y])
    assert not any(contact.ego == 0 for world in worlds for contact in world.contacts)


def test_a_retired_ego_is_frozen_and_touches_nobody(start: Start) -> None:
    simulation, world = start(on(straight_road(), standing_at(60.0, name="a"), standing_at(20.0, name="b")))
    simulation.retire(0)
    simulation.retire(0)
    worlds = driven(simulation, FULL_THROTTLE, 10.0)
    assert worlds[-1].egos.position[1, 0] > 80.0
    assert not any(w.contacts for w in worlds)
    np.testing.assert_array_equal(worlds[-1].egos.position[0], world.egos.position[0])
    assert worlds[-1].egos.driven[0] == worlds[-1].egos.speed[0] == 0.0


# The ego never vanishes


def test_an_ego_off_the_road_is_still_there_and_sees_the_traffic(start: Start) -> None:
    simulation, _ = start(busy_road())
    driven(simulation, (3.0, -0.2), 3.0)
    worlds = driven(simulation, BRAKE, 20.0)
    x, y = worlds[-1].egos.position[0]
    assert y < -4.8 - 2 * LANE_M, "it left the road"
    assert worlds[-1].egos.active[0]
    near = [np.hypot(*(world.actors.position - (x, y)).T).min(initial=math.inf) for world in worlds]
    assert min(near) < 40.0
    names = {world.name_of(int(key)) for world in worlds for key in world.actors.key}
    assert len(names) > 5


def test_others_ignore_an_ego_off_the_road_and_brake_again_once_it_is_back(start: Start) -> None:
    simulation, world = start(busy_road())
    back = world.egos.position[0].copy()

    def steered(y: float, ticks: int) -> list[World]:
        """Drives at 6 m/s or so towards a line along the road."""
        worlds = [world]
        for _ in range(ticks):
            egos = worlds[-1].egos
            bearing = 0.08 * (y - egos.position[0, 1])
            steering = 0.8 * (max(min(bearing, 0.5), -0.5) - egos.heading[0])
            worlds.append(simulation.tick(np.array([[6.0 - egos.speed[0], steering]])))
        return worlds

    away = steered(-20.0, 80)
    assert away[-1].egos.position[0, 1] < -15.0
    world = away[-1]
    world = steered(back[1], 120)[-1]
    assert world.egos.position[0, 1] == pytest.approx(back[1], abs=0.7)
    worlds = driven(simulation, BRAKE, 30.0)
    assert not any(w.contacts for w in worlds[20:])
    assert min(gaps_behind(w).min(initial=math.inf) for w in worlds[20:]) < 30.0


def test_an_ego_may_drive_past_the_end_of_the_road(start: Start) -> None:
    simulation, _ = start(busy_road(standing_at(960.0)))
    driven(simulation, FULL_THROTTLE, 6.0)
    worlds = driven(simulation, BRAKE, 20.0)
    assert worlds[-1].egos.position[0, 0] > 1020.0
    assert worlds[-1].egos.active[0]
    assert worlds[-1].egos.progress[0] == pytest.approx(simulation.plan.routes[0].length)
    assert max(len(world.actors) for world in worlds) > 0


def test_driving_across_the_other_roads_and_fields_does_not_break_sumo(start: Start) -> None:
    # SUMO itself dies when a car comes along a lane from which moveToXY led another off the road.
    simulation, _ = start(in_ingolstadt(traffic=Traffic(vehicles=50, warm_up_s=20.0), seed=5))
    worlds = driven(simulation, (3.0, 0.05), 30.0)
    assert worlds[-1].time == pytest.approx(30.0)
    assert min(world.egos.lane[0] for world in worlds) == -1
    assert np.isnan(next(world.egos.lane_offset[0] for world in worlds if world.egos.lane[0] < 0))


def test_a_careering_ego_does_not_break_sumo(start: Start) -> None:
    simulation, _ = start(in_ingolstadt())
    rng = np.random.default_rng(2)
    for _ in range(25):
        command = rng.uniform((-3.0, -0.25), (4.0, 0.25))
        world = driven(simulation, command, 1.5)[-1]
    assert world.tick == 375
    assert world.egos.driven[0] > 100


# The same again


def test_the_same_scenario_gives_the_same_worlds() -> None:
    scenario = in_ingolstadt()
    first = fingerprint(scenario)
    assert fingerprint(in_ingolstadt(seed=4)) != first
    assert fingerprint(scenario) == first, "after other episodes in the same process"
    command = [sys.executable, "-m", "tests.sumo_networks.simulation.drives", scenario.model_dump_json()]
    root = Path(__file__).parents[3]
    fresh = subprocess.run(command, cwd=root, capture_output=True, text=True, check=True)
    assert fresh.stdout.strip() == first, "in a fresh process"


# One at a time


def test_a_second_simulation_in_one_process_is_refused(start: Start) -> None:
    scenario = on(straight_road(), standing_at(100.0))
    first, _ = start(scenario)
    plan = plan_scenario(load_network(scenario.network), scenario)
    with pytest.raises(SimulationError, match="another simulation of this process is still open"):
        Simulation(plan)
    assert driven(first, BRAKE, 0.2)[-1].tick == 2, "the first one goes on"
    first.close()
    second = Simulation(plan)
    first.close()
    assert driven(second, BRAKE, 0.1)[-1].tick == 1, "the first one closes only itself"
    second.close()


def test_a_forgotten_simulation_ends_its_own_sumo_and_no_other() -> None:
    scenario = on(straight_road(), standing_at(100.0))
    plan = plan_scenario(load_network(scenario.network), scenario)
    forgotten: Simulation | None = Simulation(plan)
    forgotten = None
    assert not libsumo.isLoaded()
    forgotten = Simulation(plan)
    libsumo.close()  # as after a fatal error of SUMO
    other = Simulation(plan)
    forgotten = None
    assert forgotten is None
    assert driven(other, BRAKE, 0.2)[-1].tick == 2
    other.close()
    assert not libsumo.isLoaded()


def test_a_closed_simulation_leaves_the_next_one_alone(start: Start) -> None:
    closed, world = start(on(straight_road(), standing_at(100.0)))
    running, _ = start(on(straight_road(), standing_at(300.0)))
    before = libsumo.simulation.getTime()
    for use in (lambda: driven(closed, BRAKE, 0.1), closed.all_actors, lambda: closed.record(LogRecorder())):
        with pytest.raises(SimulationError, match="the simulation of scenario 'scenario' is closed"):
            use()
    closed.retire(0)
    assert closed.world is world
    assert libsumo.simulation.getTime() == before
    assert running.tick(BRAKE[None]).tick == 1


def test_a_running_simulation_cannot_be_copied(start: Start) -> None:
    simulation, _ = start(on(straight_road(), standing_at(100.0)))
    for duplicate in (deepcopy, pickle.dumps):
        with pytest.raises(SimulationError, match="a running simulation cannot be copied; reset another environment"):
            duplicate(simulation)
    assert simulation.tick(BRAKE[None]).tick == 1
    simulation.close()
    again = deepcopy(simulation)
    assert again.world.tick == 1
    assert not again.open


def interrupt(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    """Lets a function of libsumo end with what Ctrl-C raises, once."""
    whole = getattr(libsumo, name)

    def interrupted(*arguments: object) -> object:
        monkeypatch.setattr(libsumo, name, whole)
        whole(*arguments)
        raise KeyboardInterrupt

    monkeypatch.setattr(libsumo, name, interrupted)


def test_a_tick_that_is_interrupted_is_the_last(start: Start, monkeypatch: pytest.MonkeyPatch) -> None:
    simulation, world = start(on(straight_road(), standing_at(100.0)))
    interrupt(monkeypatch, "simulationStep")
    with pytest.raises(KeyboardInterrupt):
        simulation.tick(BRAKE[None])
    with pytest.raises(SimulationError, match="is closed, or was interrupted in a tick"):
        simulation.tick(BRAKE[None])
    assert simulation.world is world
    assert not libsumo.isLoaded()


def test_a_start_that_is_interrupted_leaves_room_for_the_next(monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = on(straight_road(), standing_at(100.0))
    plan = plan_scenario(load_network(scenario.network), scenario)
    for name in ("start", "simulationStep"):
        interrupt(monkeypatch, name)
        with pytest.raises(KeyboardInterrupt):
            Simulation(plan)
        assert not libsumo.isLoaded()
    Simulation(plan).close()


def test_a_plan_can_start_again(start: Start) -> None:
    simulation, first = start(busy_road())
    driven(simulation, FULL_THROTTLE, 2.0)
    simulation.close()
    restarted = Simulation(simulation.plan)
    again = restarted.world
    restarted.close()
    assert again.tick == 0
    np.testing.assert_array_equal(again.egos.position, first.egos.position)
    np.testing.assert_array_equal(again.actors.position, first.actors.position)


def test_traffic_the_network_cannot_carry_is_refused_and_leaves_no_simulation_open(start: Start) -> None:
    nodes = '<node id="w" x="0" y="0"/><node id="e" x="500" y="0"/>'
    network = _build("motorway", nodes, '<edge id="w_e" from="w" to="e" numLanes="2" disallow="pedestrian"/>')
    motorway = Scene(network, straight_road().mission)
    with pytest.raises(InvalidInputError, match="no sidewalk, so pedestrians must be 0"):
        start(on(motorway, traffic=Traffic(pedestrians=1)))
    other = Simulation(plan_scenario(straight_road().network, on(straight_road())))
    assert other.world.tick == 0
    other.close()


def test_a_network_file_that_has_gone_is_named(tmp_path: Path) -> None:
    net = tmp_path / "gone.net.xml"
    net.write_bytes(straight_road().network.path.read_bytes())
    scenario = Scenario(network=str(net), missions=(straight_road().mission,))
    plan = plan_scenario(load_network(str(net)), scenario)
    net.unlink()
    with pytest.raises(InvalidInputError, match=r"gone\.net\.xml' does not exist any more"):
        Simulation(plan)


def test_what_sumo_refuses_is_an_infrastructure_fault(start: Start) -> None:
    simulation, _ = start(on(straight_road(), standing_at(100.0)))
    libsumo.vehicle.remove("ego:ego")
    with pytest.raises(SimulationError, match="SUMO failed at tick 0"):
        driven(simulation, BRAKE, 0.2)


# What is read


def test_an_ego_starts_at_rest_in_the_middle_of_its_lane(start: Start) -> None:
    _, world = start(on(straight_road(), standing_at(100.0)))
    egos = world.egos
    assert (world.tick, world.time) == (0, 0.0)
    assert egos.position[0] == pytest.approx([100.0, -4.8])
    assert egos.box(0) == pytest.approx([100.0, -4.8, 0.0, 4.5, 1.8])
    assert egos.speed[0] == egos.progress[0] == egos.driven[0] == 0.0
    assert world.network.lanes.ids[egos.lane[0]] == "w_e_0"


def test_progress_lateral_and_lane_follow_the_ego(start: Start) -> None:
    simulation, _ = start(on(straight_road(), standing_at(100.0)))
    driven(simulation, (2.0, 0.02), 3.0)
    for world in driven(simulation, (0.0, -0.01), 2.0):
        egos = world.egos
        x, y = egos.position[0]
        assert egos.progress[0] == pytest.approx(x - 100.0, abs=1e-6)
        assert egos.lateral[0] == pytest.approx(y + 4.8, abs=1e-6)
        assert egos.route_heading_error[0] == pytest.approx(egos.heading[0], abs=1e-6)
        lane = "w_e_0" if y < -3.2 else "w_e_1" if y < 0 else "e_w_1"
        assert world.network.lanes.ids[egos.lane[0]] == lane or abs(y + 3.2) < 1.0 or abs(y) < 1.0
        assert egos.driven[0] >= egos.progress[0]
        assert world.time == pytest.approx(world.tick * TICK_S)


def test_actors_are_read_as_boxes_in_the_network_frame(start: Start) -> None:
    simulation, _ = start(busy_road())
    for _ in range(5):
        world = driven(simulation, BRAKE, 1.0)[-1]
        actors = world.actors
        assert len(actors) > 3
        assert (np.diff(actors.key) > 0).all()
        for row, key in enumerate(actors.key):
            name = world.name_of(int(key))
            length, eastward = libsumo.vehicle.getLength(name), libsumo.vehicle.getRoadID(name) == "w_e"
            assert actors.length[row] == length
            assert actors.width[row] == libsumo.vehicle.getWidth(name)
            assert actors.kind[row] == ActorKind[libsumo.vehicle.getTypeID(name).split("@")[0].upper()]
            assert world.network.lanes.ids[actors.lane[row]] == libsumo.vehicle.getLaneID(name)
            assert actors.speed[row] == libsumo.vehicle.getSpeed(name)
            x, y = libsumo.vehicle.getPosition(name)
            assert math.cos(actors.heading[row]) * (1 if eastward else -1) > 0.9
            back = length / 2 * (-1 if eastward else 1)
            assert actors.position[row] == pytest.approx([x + back, y], abs=0.5)
            assert np.hypot(*(actors.position[row] - world.egos.position[0])) < 110.0


def test_everybody_within_100_metres_is_seen(start: Start) -> None:
    simulation, _ = start(busy_road())
    world = driven(simulation, BRAKE, 2.0)[-1]
    x, y = world.egos.position[0]
    near = set()
    for name in libsumo.vehicle.getIDList():
        vx, vy = libsumo.vehicle.getPosition(name)
        if math.hypot(vx - x, vy - y) < 95.0 and name != "ego:ego":
            near.add(name)
    assert near
    assert near <= {world.name_of(int(key)) for key in world.actors.key}


def test_a_key_stays_with_its_actor(start: Start) -> None:
    simulation, _ = start(in_ingolstadt())
    last: dict[int, tuple[np.ndarray, int, float]] = {}
    for world in driven(simulation, BRAKE, 10.0):
        actors = world.actors
        for row, key in enumerate(actors.key):
            if int(key) in last:
                position, kind, length = last[int(key)]
                assert np.hypot(*(actors.position[row] - position)) < 3.0
                assert (actors.kind[row], actors.length[row]) == (kind, length)
        last = {
            int(key): (actors.position[row], int(actors.kind[row]), float(actors.length[row]))
            for row, key in enumerate(actors.key)
        }
    assert len(last) > 5


def test_an_earlier_world_does_not_change_any_more(start: Start) -> None:
    simulation, world = start(busy_road())
    kept = [array.copy() for array in (world.egos.position, world.egos.speed, world.actors.position, world.signals)]
    driven(simulation, FULL_THROTTLE, 2.0)
    for array, copy in zip(
        (world.egos.position, world.egos.speed, world.actors.position, world.signals), kept, strict=True
    ):
        np.testing.assert_array_equal(array, copy)


def test_signals_are_those_sumo_shows(start: Start) -> None:
    simulation, _ = start(on(lit_crossing()))
    signals, seen = simulation.plan.network.signals, set()
    meaning = {"G": LightState.GREEN, "g": LightState.GREEN, "y": LightState.YELLOW, "r": LightState.RED}
    for _ in range(320):
        world = driven(simulation, BRAKE, 0.3)[-1]
        for k, (light, link) in enumerate(zip(signals.light, signals.link, strict=True)):
            text = libsumo.trafficlight.getRedYellowGreenState(str(signals.light_ids[light]))
            assert world.signals[k] == meaning[text[link]]
        seen.add(tuple(world.signals))
    assert {state for states in seen for state in states} == {LightState.GREEN, LightState.YELLOW, LightState.RED}


# The population


@pytest.mark.parametrize(
    ("network", "seed"), [("ingolstadt", 3), ("ingolstadt", 4), ("crossing", 0)], ids=lambda value: str(value)
)
def test_the_population_stays_constant(network: str, seed: int, start: Start) -> None:
    traffic = Traffic(vehicles=30, bicycles=6, pedestrians=20, warm_up_s=20.0)
    if network == "ingolstadt":
        scenario = in_ingolstadt(traffic=traffic, seed=seed)
    else:
        scenario = on(crossing_for_pedestrians(), traffic=traffic, seed=seed)
    simulation, _ = start(scenario)
    replaced = 0
    for _ in range(600):
        simulation.tick(BRAKE[None])
        vehicles, pedestrians = arrived()
        # On the road or waiting for room, the ego's proxy included; what has just arrived is replaced in the next tick.
        assert libsumo.simulation.getMinExpectedNumber() + len(vehicles) + len(pedestrians) == 57
        replaced += len(vehicles) + len(pedestrians)
    assert replaced > 3, "nobody had to be replaced"


def test_who_is_removed_for_an_event_is_replaced_once(start: Start) -> None:
    ambulance = YieldToEmergencyVehicle(name="it", at_m=20.0, behind_m=60.0)
    simulation, world = start(busy_road(standing_at(300.0), events=(ambulance,)))
    there = {name for name in libsumo.vehicle.getIDList() if role_of(name) is Role.VEHICLE}
    removed: set[str] = set()
    while world.time < 20.0:
        world = simulation.tick(np.array([[1.0 if world.egos.speed[0] < 6.0 else 0.0, 0.0]]))
        vehicles, _ = arrived()
        now = set(libsumo.vehicle.getIDList())
        removed |= {name for name in there - now if name not in vehicles}
        there = {name for name in now if role_of(name) is Role.VEHICLE}
        waiting = [name for name in libsumo.simulation.getPendingVehicles() if role_of(name) is Role.VEHICLE]
        assert len(there) + len(waiting) + sum(role_of(name) is Role.VEHICLE for name in vehicles) == 40
    assert len(removed) > 0, "nobody had to make room"


def test_nobody_stands_near_an_ego_when_it_starts(start: Start) -> None:
    for seed in range(4):
        _, world = start(busy_road(seed=seed))
        fronts = world.actors.position[:, 0] + world.actors.length / 2 * np.cos(world.actors.heading)
        same_side = world.actors.position[:, 1] < 0
        assert (np.abs(fronts - 500.0) > START_CLEARANCE_M - 3.0)[same_side].all()
        assert not world.contacts


def test_nobody_stands_near_a_standing_ego_when_another_one_starts_moving(start: Start) -> None:
    moving = standing_at(100.0, name="moving").model_copy(update={"start_speed_mps": 10.0})
    near: list[float] = []
    for seed in range(4):
        _, world = start(busy_road(moving, standing_at(500.0, name="standing"), seed=seed))
        fronts = world.actors.position[:, 0] + world.actors.length / 2 * np.cos(world.actors.heading)
        same_side = world.actors.position[:, 1] < 0
        assert (np.abs(fronts - 500.0) > START_CLEARANCE_M - 3.0)[same_side].all()
        assert not world.contacts
        near += np.abs(fronts - 100.0)[same_side].tolist()
    assert min(near) < START_CLEARANCE_M - 3.0, "a moving ego starts amid the traffic"


def test_pedestrians_walk_and_cross(start: Start) -> None:
    scene = crossing_for_pedestrians()
    mission = Mission(start=Place(lane="w_c_1", position_m=150.0), goal=Place(lane="c_e_1", position_m=-1.0))
    simulation, _ = start(on(scene, mission, traffic=Traffic(pedestrians=60, warm_up_s=20.0)))
    first: dict[int, np.ndarray] = {}
    furthest, on_crossings = 0.0, set()
    for world in driven(simulation, BRAKE, 60.0):
        actors = world.actors
        assert (actors.kind == ActorKind.PEDESTRIAN).all()
        assert (actors.speed < 3.0).all()
        for row, key in enumerate(actors.key):
            furthest = max(
                furthest, float(np.hypot(*(actors.position[row] - first.setdefault(int(key), actors.position[row]))))
            )
            if actors.lane[row] >= 0 and scene.network.lanes.crossing[actors.lane[row]]:
                on_crossings.add(int(key))
    assert len(first) > 20
    assert furthest > 20.0
    assert len(on_crossings) > 3


def test_a_mission_may_be_called_as_the_traffic_is(start: Start) -> None:
    names = ("vehicle-1", "pedestrian-1", "obstacle-0")
    missions = [standing_at(300.0 + 100 * i, name=name) for i, name in enumerate(names)]
    simulation, _ = start(busy_road(*missions))
    world = driven(simulation, BRAKE, 2.0)[-1]
    assert world.egos.names == names
    assert len(world.actors) > 3
