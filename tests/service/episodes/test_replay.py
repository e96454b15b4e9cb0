from __future__ import annotations

import gzip
import json

import numpy as np
import pytest

from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.evaluation.records.record import EpisodeRecord, Versions
from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.evaluation.records.trajectory import Trajectory, TrajectoryRecorder
from dohyo.service.episodes.replay import encode, replay_of
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.routes.routing import plan_route
from tests.evaluation.builders import ego, episode, infraction, world

SCENARIO, _, _, RIGHT_TURN, *_ = load_benchmark("quickstart").scenarios([0])


@pytest.fixture(scope="module")
def network() -> RoadNetwork:
    return load_network("ingolstadt")


def driven(network: RoadNetwork, *infractions: InfractionKind) -> EpisodeRecord:
    egos = ego(*(infraction(kind, time_s=1.0 + number) for number, kind in enumerate(infractions)))
    record = episode(egos, name="made")
    versions = Versions(dohyo="0.1.0", sumo="1.28.0", network_sha256=network.sha256)
    return record.model_copy(update={"scenario": SCENARIO, "versions": versions})


def with_signals(trajectory: Trajectory, changes: list[tuple[int, int, int]]) -> Trajectory:
    columns = {name: getattr(trajectory, name) for name in Trajectory.__slots__ if name != "signals"}
    return Trajectory(**columns, signals=np.array(changes, dtype=np.int32).reshape(-1, 3))


def test_who_leaves_and_comes_back_has_two_appearances(network: RoadNetwork) -> None:
    recorder = TrajectoryRecorder()
    for tick, actors in enumerate([(3, 7), (3,), (3, 7), (3, 7), (7,)]):
        recorder.append(world(tick, x=float(tick), actors=actors))
    replay = replay_of(driven(network), recorder.finish(), network, episode="ep-1", rules="2.0")
    found = {(one["name"], one["first"]): one for one in replay["actors"]}
    assert set(found) == {("ego0", 0), ("car3", 0), ("car7", 0), ("car7", 2)}
    assert found["ego0", 0]["x"] == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert found["ego0", 0]["kind"] == "ego"
    assert found["car3", 0]["x"] == [3.0] * 4
    assert found["car7", 0]["x"] == [7.0]
    assert found["car7", 2]["x"] == [7.0] * 3
    assert (found["car7", 2]["length"], found["car7", 2]["width"], found["car7", 2]["kind"]) == (5.0, 1.8, "car")
    assert (replay["ticks"], replay["dt_s"], replay["episode"]) == (5, 0.1, "ep-1")


def test_two_actors_one_after_the_other_are_two(network: RoadNetwork) -> None:
    recorder = TrajectoryRecorder()
    recorder.append(world(0, actors=(3,)))
    recorder.append(world(1, actors=(4,)))  # the next key in the next tick: no gap in time, but somebody else
    replay = replay_of(driven(network), recorder.finish(), network, episode="ep", rules="2.0")
    assert [(one["name"], one["first"], len(one["x"])) for one in replay["actors"]] == [
        ("ego0", 0, 2),
        ("car3", 0, 1),
        ("car4", 1, 1),
    ]


def test_series_and_decimals(network: RoadNetwork) -> None:
    recorder = TrajectoryRecorder()
    for tick in range(3):
        recorder.append(world(tick, x=0.1 * tick, lateral=1 / 3))
    (one,) = replay_of(driven(network), recorder.finish(), network, episode="ep", rules="2.0")["egos"]
    assert one["series"] == {
        "speed": [10.0] * 3,
        "acceleration": [-1.0] * 3,
        "steering": [0.25] * 3,
        "progress": [0.0, 0.1, 0.2],
        "lateral": [0.33] * 3,
    }
    assert (one["length"], one["width"]) == (4.5, 2.0)


def test_the_score_and_what_each_infraction_costs(network: RoadNetwork) -> None:
    record = driven(network, InfractionKind.COLLISION_VEHICLE, InfractionKind.RED_LIGHT, InfractionKind.BLOCKED)
    recorder = TrajectoryRecorder()
    recorder.append(world(0))
    (one,) = replay_of(record, recorder.finish(), network, episode="ep", rules="2.0")["egos"]
    assert one["score"]["factors"] == [["collision_vehicle", 0.6], ["red_light", 0.7], ["blocked", 1.0]]
    assert one["score"]["rc"] == 80.0
    assert one["score"]["ds"] == pytest.approx(80 * 0.42)
    assert [(mark["kind"], mark["time_s"], mark["factor"]) for mark in one["infractions"]][1] == ("red_light", 2.0, 0.7)


def test_the_route_is_the_missions_and_lies_within_the_bounds(network: RoadNetwork) -> None:
    recorder = TrajectoryRecorder()
    recorder.append(world(0, x=-300.0))
    replay = replay_of(driven(network), recorder.finish(), network, episode="ep", rules="2.0")
    route = np.array(replay["egos"][0]["route"])
    expected = plan_route(network, SCENARIO.missions[0]).position
    assert np.abs(route - expected).max() <= 0.005001
    x0, y0, x1, y1 = replay["bounds"]
    assert x0 == -340.0  # the ego at -300, and the margin
    assert ((route > (x0, y0)) & (route < (x1, y1))).all()


def test_lights_stand_on_their_stop_lines(network: RoadNetwork) -> None:
    route = plan_route(network, SCENARIO.missions[0])
    lines = network.stop_lines
    row = next(
        row
        for row in np.flatnonzero(lines.lit)
        if len(network.connections_from(int(lines.lane[row]))) >= 2
        and np.abs(route.position - lines.segment[row, :2]).max(axis=1).min() < 30.0
    )
    signals = [int(network.connections.signal[one]) for one in network.connections_from(int(lines.lane[row]))]
    first, second = signals[0], signals[1]
    recorder = TrajectoryRecorder()
    recorder.append(world(0, x=float(route.position[0, 0])))
    trajectory = recorder.finish()

    changes = [(0, first, 1), (0, second, 1), (50, first, 3), (90, first, 2)]
    replay = replay_of(driven(network), with_signals(trajectory, changes), network, episode="ep", rules="2.0")
    line = np.round(lines.segment[row], 2).tolist()
    here = [one["changes"] for one in replay["signals"] if one["line"] == line]
    assert here == [[[0, 1], [50, 3], [90, 2]], [[0, 1]]]

    agreeing = [(0, first, 1), (0, second, 1), (50, first, 3), (50, second, 3)]
    replay = replay_of(driven(network), with_signals(trajectory, agreeing), network, episode="ep", rules="2.0")
    assert [one["changes"] for one in replay["signals"] if one["line"] == line] == [[[0, 1], [50, 3]]]


def test_lights_far_away_are_left_out(network: RoadNetwork) -> None:
    record = driven(network).model_copy(update={"scenario": RIGHT_TURN})
    every = [(0, signal, 1) for signal in range(len(network.signals.light))]
    trajectory = with_signals(TrajectoryRecorder().finish(), every)
    replay = replay_of(record, trajectory, network, episode="ep", rules="2.0")
    x0, y0, x1, y1 = replay["bounds"]
    assert len(replay["signals"]) == 11  # of the junction's 17 stop lines; those of the far side are beyond the margin
    assert np.count_nonzero(network.stop_lines.lit) == 17
    for one in replay["signals"]:
        assert x0 <= one["line"][0] <= x1
        assert y0 <= one["line"][1] <= y1


def test_an_episode_that_never_began_has_a_replay_without_motion(network: RoadNetwork) -> None:
    replay = replay_of(driven(network), TrajectoryRecorder().finish(), network, episode="ep", rules="2.0")
    assert (replay["ticks"], replay["actors"], replay["egos"][0]["series"]["speed"]) == (0, [], [])


def test_encoding_is_plain_json_and_repeatable(network: RoadNetwork) -> None:
    recorder = TrajectoryRecorder()
    recorder.append(world(0, actors=(3,)))
    replay = replay_of(driven(network), recorder.finish(), network, episode="ep", rules="2.0")
    replay["egos"][0]["series"]["speed"] = [float("nan"), 1.25]
    content = encode(replay)
    assert content == encode(replay)
    assert json.loads(gzip.decompress(content))["egos"][0]["series"]["speed"] == [None, 1.25]


def test_another_network_of_the_same_name_is_refused(network: RoadNetwork) -> None:
    with pytest.raises(InvalidInputError, match="was driven on network 'ingolstadt' 111111111111"):
        replay_of(
            driven(network).model_copy(update={"versions": episode().versions}),
            TrajectoryRecorder().finish(),
            network,
            episode="ep",
            rules="2.0",
        )
