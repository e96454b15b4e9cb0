"""State: every number of it, on hand-made worlds and in a drive."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from dohyo.agents.hierarchical.state.state import WAYPOINTS_M, StateConfig, StateEncoder
from dohyo.agents.hierarchical.vision.latents import Encoder
from dohyo.agents.mcts.predictors import recording as motion
from dohyo.sumo_networks.envs.driving_env import DrivingEnv
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.scenario import Traffic
from dohyo.sumo_networks.sensors import Track, make_sensors
from tests.agents.hierarchical.vision.weights import picture, untrained
from tests.worlds import Scene, lit_crossing, straight_road

TWIN = StateConfig(vision="none")


@pytest.fixture(scope="module")
def weights(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("encoder") / "e.safetensors"
    untrained(path)
    return path


def seen(scene: Scene, encoder: StateEncoder) -> dict[str, np.ndarray]:
    world = scene.world()
    return {sensor.name: sensor.read(world, 0) for sensor in make_sensors(encoder.sensors)}


def part(encoder: StateEncoder, scene: Scene, name: str) -> np.ndarray:
    return encoder.encode(seen(scene, encoder))[encoder.layout[name]]


def test_the_layout_covers_the_vector_exactly(weights):
    for config in (TWIN, StateConfig(encoder=weights), StateConfig(encoder=weights, frames=2)):
        encoder = StateEncoder(config)
        rows = np.concatenate([np.arange(encoder.size)[part] for part in encoder.layout.values()])
        assert rows.tolist() == list(range(encoder.size))
        assert encoder.space.shape == (encoder.size,)
    shared = ("waypoints", "deviation", "limits", "place", "motion")
    assert tuple(StateEncoder(TWIN).layout) == (
        "actors",
        "strips",
        "junctions",
        "crossings",
        "distances",
        "allowances",
        *shared,
    )
    assert tuple(StateEncoder(StateConfig(encoder=weights)).layout) == ("z", *shared)
    assert StateEncoder(StateConfig(encoder=weights)).layout["z"] == slice(0, 4 * 12)


def test_only_the_sensors_it_names_are_needed(weights):
    scene = lit_crossing().with_ego(x=-60.0, speed=5.0).with_actor(x=-40.0)
    for config in (TWIN, StateConfig(encoder=weights)):
        encoder = StateEncoder(config)
        state = encoder.encode(seen(scene, encoder))
        assert state.dtype == np.float32
        assert encoder.space.contains(state)
        assert np.isfinite(state).all()


def test_pictures_and_a_filter_need_no_privileges(weights):
    encoder = StateEncoder(StateConfig(encoder=weights, localization="es-ekf"))
    make_sensors(encoder.sensors, Track.MAP)
    with pytest.raises(InvalidInputError, match="privileged"):
        make_sensors(StateEncoder(TWIN).sensors, Track.MAP)


def test_waypoints_lie_on_the_path():
    got = part(StateEncoder(TWIN), straight_road().with_ego(x=100.0, left=0.5), "waypoints").reshape(-1, 2)
    assert got[:, 0] * 30.0 == pytest.approx(WAYPOINTS_M, abs=1e-3)
    assert got[:, 1] * 10.0 == pytest.approx([-0.5] * len(WAYPOINTS_M), abs=1e-3)


@pytest.mark.parametrize(("left", "heading"), [(0.0, 0.0), (0.6, 0.0), (-1.2, 0.2), (0.3, -0.4)])
@pytest.mark.parametrize("x", [100.0, 100.4, 100.7])
def test_deviation_by_hand(x, left, heading):
    scene = straight_road().with_ego(x=x, left=left, heading=heading)
    expected = [left / 3.0, math.sin(heading), math.cos(heading)]
    assert part(StateEncoder(TWIN), scene, "deviation") == pytest.approx(expected, abs=1e-3)


def test_motion_limits_and_place_by_hand():
    scene = straight_road().with_ego(x=100.0, left=0.5, heading=0.1, speed=6.0)
    encoder = StateEncoder(TWIN)
    assert part(encoder, scene, "motion") == pytest.approx([0.4, 1.0, 0.0])
    creeping = straight_road().with_ego(x=100.0, speed=0.3)
    assert part(encoder, creeping, "motion") == pytest.approx([0.02, 0.3, 0.0])
    assert part(encoder, scene, "limits") == pytest.approx([13.89 / 15.0] * 3)
    x = 100.0 - straight_road().route.position[0, 0]
    assert part(encoder, scene, "place") == pytest.approx([x / 500, 0.001, math.cos(0.1), math.sin(0.1)], abs=1e-5)


def test_a_path_led_aside_is_what_the_state_is_told_of():
    encoder = StateEncoder(TWIN)
    observation = seen(straight_road().with_ego(x=100.0), encoder)
    route = observation["route"].copy()
    route[:, 1] += 3.2
    state = encoder.encode({**observation, "route": route})
    assert state[encoder.layout["deviation"]][0] == pytest.approx(-3.2 / 3.0)


def test_the_last_four_pictures_in_order_and_each_is_encoded_once(weights, monkeypatch):
    counted: list[int] = []
    real = Encoder.latent
    monkeypatch.setattr(Encoder, "latent", lambda self, shown: counted.append(1) or real(self, shown))
    encoder = StateEncoder(StateConfig(encoder=weights))
    rest = seen(straight_road().with_ego(x=100.0), encoder)
    states = [encoder.encode({**rest, "camera_semantic": picture(n)})[encoder.layout["z"]] for n in range(6)]
    assert len(counted) == 6
    alone = [real(encoder._encoder, picture(n)) for n in range(6)]
    assert np.array_equal(states[0], np.concatenate([alone[0]] * 4)), "at first, the first for all"
    assert np.array_equal(states[1], np.concatenate([alone[0]] * 3 + [alone[1]]))
    assert np.array_equal(states[5], np.concatenate(alone[2:6]))
    encoder.reset()
    again = encoder.encode({**rest, "camera_semantic": picture(5)})[encoder.layout["z"]]
    assert np.array_equal(again, np.concatenate([alone[5]] * 4)), "nothing of the last episode is left"


def test_the_twin_never_loads_an_encoder(tmp_path):
    missing = tmp_path / "none.safetensors"
    StateEncoder(StateConfig(vision="none", encoder=missing))
    with pytest.raises(InvalidInputError, match="no encoder"):
        StateEncoder(StateConfig(encoder=missing))


def test_a_filter_stands_first_and_then_sees_nearly_what_is_true():
    quiet = Traffic(warm_up_s=0.0)
    scenario = motion.scenario(motion.MotionRequest(egos=1), "town-train", 2).model_copy(update={"traffic": quiet})
    believed, true = StateEncoder(StateConfig(vision="none", localization="es-ekf")), StateEncoder(TWIN)
    env = DrivingEnv(scenario, tuple({*believed.sensors, *true.sensors}), "acceleration_steering", reward=None)
    off: list[np.ndarray] = []
    try:
        observations, _ = env.reset()
        standing = 0
        for _ in range(110):
            (observation,) = observations.values()
            states = [encoder.encode(observation) for encoder in (believed, true)]
            standing += believed.calibrating
            if not believed.calibrating:
                off.append(np.abs(states[0] - states[1]))
            action = [-3.0, 0.0] if believed.calibrating else [1.0, 0.0]
            observations, *_ = env.step(dict.fromkeys(observations, np.array(action)))
    finally:
        env.close()
    assert 25 <= standing <= 40, "three seconds"
    errors = np.array(off)
    for name, most in (("deviation", 0.2), ("place", 0.05), ("motion", 0.0), ("distances", 0.0)):
        assert errors[:, true.layout[name]].max() <= most, name
    assert errors[:, true.layout["deviation"]].max() > 0.0, "it is an estimate"


def test_the_encoders_file_is_part_of_what_a_state_is(weights):
    assert StateEncoder(StateConfig(encoder=weights)).files == (weights,)
    assert StateEncoder(TWIN).files == ()
