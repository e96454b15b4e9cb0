"""Logs and their replay: content hashes, damaged files, and others that do not care what the ego does."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from dohyo.sumo_networks.envs.driving_env import DrivingEnv
from dohyo.sumo_networks.errors import InvalidInputError, SimulationError
from dohyo.sumo_networks.scenario import Mission, Place, Scenario
from dohyo.sumo_networks.simulation import Replay, plan_scenario
from dohyo.sumo_networks.simulation.replay import in_sight
from dohyo.sumo_networks.simulation.traffic_log import Log, LogRecorder, log_path, logs_folder, read_log, write_log
from dohyo.sumo_networks.world import ActorKind, Actors, LightState
from tests.conftest import MakeEnv
from tests.sumo_networks.simulation.drives import busy_road
from tests.worlds import Scene, lit_crossing, stop_sign_crossing, straight_road

TICKS = 30


@pytest.fixture(autouse=True)
def _home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setenv("DOHYO_HOME", str(tmp_path))
    read_log.cache_clear()
    yield
    read_log.cache_clear()


def logged(scene: Scene, seconds: float = TICKS / 10) -> Log:
    recorder = LogRecorder()
    for world in scene.worlds(seconds):
        recorder.append([world.names[key] for key in world.actors.key], world.actors, world.signals)
    return recorder.finish()


def scenario(scene: Scene, log: Log, **rest: object) -> Scenario:
    write_log(log)
    return Scenario(
        network=str(scene.network.path), missions=(scene.mission,), log=log.sha256(), duration_s=3.0, **rest
    )


def crossing_cars() -> Scene:
    scene = straight_road().with_ego(x=0).with_actor(x=40, speed=8, left=0.0)
    return scene.with_actor(x=60, speed=5, left=3.2).with_pedestrian(30, 1.0, y=-9, heading=1.57)


def test_a_log_is_what_was_recorded() -> None:
    log, worlds = logged(crossing_cars()), crossing_cars().worlds(TICKS / 10)
    assert log.ticks == len(worlds) == TICKS + 1
    for tick in (0, 7, TICKS):
        actors, expected = log.actors(tick), worlds[tick].actors
        assert actors.position == pytest.approx(expected.position, abs=0.0051)
        assert actors.speed == pytest.approx(expected.speed, abs=0.0051)
        assert actors.kind.tolist() == expected.kind.tolist()
        assert actors.boxes()[:, 3:] == pytest.approx(expected.boxes()[:, 3:])


def replaying(scene: Scene, one: Scenario) -> Replay:
    return Replay(plan_scenario(scene.network, one))


def test_who_comes_later_or_goes_keeps_its_key() -> None:
    def row(name: str, x: float) -> tuple[list[str], Actors]:
        one, nought = np.ones(1, dtype=np.int64), np.zeros(1)
        return [name], Actors(0 * one, 0 * one, np.array([[x, 0.0]]), nought, nought, nought + 4, nought + 2, -one, one)

    recorder, lights = LogRecorder(), np.zeros(0, dtype=np.int64)
    for name, x in (("b", 1.0), ("a", 2.0), ("b", 3.0)):
        recorder.append(*row(name, x), lights)
    log = recorder.finish()
    assert log.names == ("b", "a")
    assert [log.actors(tick).key.tolist() for tick in range(3)] == [[0], [1], [0]]


def test_the_hash_is_that_of_the_content_and_survives_the_disk() -> None:
    log = logged(crossing_cars())
    assert log.sha256() == logged(crossing_cars()).sha256()
    assert log.sha256() != logged(crossing_cars().with_actor(x=90)).sha256()
    write_log(log)
    assert read_log(log.sha256(), logs_folder()).sha256() == log.sha256()


def test_logs_that_are_missing_damaged_or_another_are_refused() -> None:
    log, other = logged(crossing_cars()), logged(straight_road().with_ego(x=0).with_actor(x=50))
    with pytest.raises(InvalidInputError, match=r"no log .*benchmarks prepare"):
        read_log(log.sha256(), logs_folder())
    path, another = write_log(log), write_log(other)
    path.write_bytes(another.read_bytes())
    with pytest.raises(InvalidInputError, match="changed since it was written"):
        read_log(log.sha256(), logs_folder())
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(InvalidInputError, match="cannot be read"):
        read_log(log.sha256(), logs_folder())


def test_a_log_of_another_network_is_refused_when_the_plan_is_made() -> None:
    recorder, scene = LogRecorder(), crossing_cars()
    for world in scene.worlds(TICKS / 10):
        names = [world.names[key] for key in world.actors.key]
        recorder.append(names, world.actors, world.signals, scene.network)
    log, other = recorder.finish(), stop_sign_crossing()
    assert log.sha256() == logged(scene).sha256(), "the network is no part of the content"
    one = scenario(scene, log)
    assert read_log(log.sha256(), logs_folder()).network == scene.network.sha256
    replaying(scene, one)
    elsewhere = one.model_copy(update={"network": str(other.network.path), "missions": (other.mission,)})
    with pytest.raises(InvalidInputError, match=r"expected a log of network 'crossing_priority_stop-.* of another"):
        DrivingEnv(elsewhere, sensors=["objects"])
    with pytest.raises(InvalidInputError, match="on one network"):
        recorder.append([], world.actors.take(np.zeros(len(world.actors), np.bool_)), world.signals, other.network)


def test_an_old_log_with_lanes_or_lights_that_the_network_lacks_is_refused() -> None:
    lit = lit_crossing().with_ego(x=-100)
    with pytest.raises(InvalidInputError, match="got one of another network"):
        plan_scenario(straight_road().network, scenario(straight_road().with_ego(x=0), logged(lit)))
    driving = lit_crossing().with_ego(x=-100).with_actor(x=150.0, speed=1.0)
    log = logged(driving)
    assert log.network is None
    assert log.lane.max() >= len(straight_road().network.lanes.ids)
    unlit = dataclasses.replace(log, signals=np.zeros((0, 3), dtype=np.int32))
    with pytest.raises(InvalidInputError, match="got one of another network"):
        plan_scenario(straight_road().network, scenario(straight_road().with_ego(x=0), unlit))


def test_a_log_that_ends_before_its_scenario_is_refused_when_the_plan_is_made() -> None:
    scene = crossing_cars()
    short, long = logged(scene, seconds=2.8), logged(scene, seconds=3.0)
    plan_scenario(scene.network, scenario(scene, long))
    with pytest.raises(InvalidInputError, match=r"expected a log of 3 s, got one of 2\.8 s"):
        plan_scenario(scene.network, scenario(scene, short))


def test_a_log_without_a_tick_is_refused() -> None:
    with pytest.raises(InvalidInputError, match="expected at least one tick"):
        LogRecorder().finish()


def test_others_do_the_same_whatever_the_ego_does() -> None:
    one = scenario(crossing_cars(), logged(crossing_cars()))
    seen = []
    for command in (0.0, 4.0):
        replay = replaying(straight_road(), one)
        worlds = [replay.world, *(replay.tick(np.array([[command, 0.0]])) for _ in range(TICKS))]
        seen.append([world.actors.position for world in worlds])
        assert (worlds[-1].egos.position[0, 0] > 5.0) == (command > 0)
    for first, second in zip(*seen, strict=True):
        assert first == pytest.approx(second)


def test_an_ego_that_drives_into_a_recorded_car_touches_it() -> None:
    scene = straight_road().with_ego(x=0).with_actor(x=6.0)
    replay = replaying(scene, scenario(scene, logged(scene)))
    assert not replay.world.contacts
    touched = [one for _ in range(TICKS) for one in replay.tick(np.array([[4.0, 0.0]])).contacts]
    assert {one.kind for one in touched} == {ActorKind.CAR}


def test_an_ego_that_starts_in_the_midst_has_its_speed() -> None:
    scene = crossing_cars()
    moving = scene.mission.model_copy(update={"start_speed_mps": 9.0})
    one = scenario(scene, logged(scene)).model_copy(update={"missions": (moving,)})
    world = replaying(scene, one).world
    assert world.egos.speed.tolist() == [9.0]


def test_lights_change_as_recorded_and_are_the_same_array_between() -> None:
    scene = lit_crossing().with_ego(x=-100).with_lights(lambda t: LightState.RED if t < 1.05 else LightState.GREEN)
    replay = replaying(scene, scenario(scene, logged(scene)))
    worlds = [replay.world, *(replay.tick(np.zeros((1, 2))) for _ in range(TICKS))]
    assert set(worlds[10].signals.tolist()) == {LightState.RED}
    assert set(worlds[11].signals.tolist()) == {LightState.GREEN}
    assert worlds[11].signals is worlds[12].signals


def test_only_those_within_100_m_are_seen() -> None:
    scene = straight_road().with_ego(x=0).with_actor(x=99.0).with_actor(x=103.0)
    world = scene.world()
    assert in_sight(world.actors, world.egos).position[:, 0].tolist() == [99.0]


def test_several_replays_run_in_one_process_and_end_with_their_log() -> None:
    one = scenario(crossing_cars(), logged(crossing_cars()))
    first, second = DrivingEnv(one, sensors=["objects"]), DrivingEnv(one, sensors=["objects"])
    observations, _ = first.reset()
    others, _ = second.reset()
    assert np.array_equal(observations["ego"]["objects"], others["ego"]["objects"])
    replay = replaying(straight_road(), one)
    for _ in range(TICKS):
        replay.tick(np.zeros((1, 2)))
    with pytest.raises(SimulationError, match="ends at tick 30"):
        replay.tick(np.zeros((1, 2)))


def test_a_replay_is_neither_copied_while_it_runs_nor_driven_after_its_end() -> None:
    replay = replaying(straight_road(), scenario(crossing_cars(), logged(crossing_cars())))
    with pytest.raises(SimulationError, match="a running simulation cannot be copied"):
        copy.deepcopy(replay)
    replay.close()
    with pytest.raises(SimulationError, match="the replay of scenario 'scenario' is closed"):
        replay.tick(np.zeros((1, 2)))


def test_an_environment_is_truncated_when_its_duration_is_over() -> None:
    env = DrivingEnv(scenario(crossing_cars(), logged(crossing_cars())), sensors=["objects"], reward=None)
    env.reset()
    ticks, ended = 0, False
    while not ended:
        _, _, _, truncations, _ = env.step({"ego": np.zeros(2, dtype=np.float32)})
        ticks, ended = ticks + 1, truncations["ego"]
    assert ticks == TICKS
    with pytest.raises(InvalidInputError, match="replays a log"):
        env.record(LogRecorder())


def test_fields_that_most_scenarios_lack_leave_their_hashes_alone() -> None:
    place = Place(lane="E_0")
    plain = Scenario(network="x", missions=(Mission(start=place, goal=place),))
    assert plain.content_hash() == "8d895391f97d96a480ea6c767bce2379e8c915c4301bd3b30f99004af43296d2"
    assert not {"log", "duration_s", "reference_m"} & set(plain.model_dump())
    assert plain.model_copy(update={"log": "0" * 64}).content_hash() != plain.content_hash()


def test_the_last_bit_of_a_coordinate_makes_no_other_log() -> None:
    here = straight_road().with_ego(x=0).with_actor(x=40.003, speed=8.001)
    there = straight_road().with_ego(x=0).with_actor(x=40.003 + 1e-7, speed=8.001 + 1e-7)
    assert logged(here).sha256() == logged(there).sha256()


def test_the_path_of_a_log_is_in_the_users_folder(tmp_path: Path) -> None:
    assert log_path("ab") == tmp_path / "logs" / "ab.npz"


def test_a_second_run_in_one_environment_records_its_own_vehicles(make_env: MakeEnv) -> None:
    """Names such as vehicle-3 come again in every run, with other types and sizes."""

    def recorded(env: DrivingEnv, seed: int) -> Log:
        recorder = LogRecorder()
        env.reset(seed=seed)
        env.record(recorder)
        return recorder.finish()

    busy = busy_road(duration_s=10.0)
    used = make_env(busy, reward=None)
    recorded(used, 1)
    again = recorded(used, 2)
    fresh = recorded(make_env(busy, reward=None), 2)
    assert again.sha256() == fresh.sha256()
    assert len(set(fresh.kind.tolist())) > 1, "vehicles of one size would prove nothing"
