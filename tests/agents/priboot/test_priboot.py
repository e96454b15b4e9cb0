"""PRIBOOT on hand-made roads, with policies that always answer the same waypoints."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from gymnasium.spaces import Box, Dict
from torch import Tensor, nn

from dohyo.agents.endless_driving.experts import make_expert
from dohyo.agents.learning.policies.export import export
from dohyo.agents.priboot import rules
from dohyo.agents.priboot.measurements import BLOCKED, LIMIT, MEASUREMENTS, SPEED, TARGET, measured
from dohyo.agents.priboot.priboot import Priboot
from dohyo.agents.priboot.view import HEIGHT, WIDTH
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.world import ActorKind, LightState
from tests.agents.driving import drive, observed, speeds
from tests.worlds import Scene, lit_crossing, straight_road


class Fixed(nn.Module):
    """Waypoints straight ahead at a speed, or along a bend to the left."""

    def __init__(self, speed: float, left: float = 0.0) -> None:
        super().__init__()
        at = 0.5 * speed * torch.arange(1.0, 5.0)
        self.register_buffer("points", torch.stack([at, left * at], dim=1).flatten())

    def forward(self, observation: dict[str, Tensor]) -> Tensor:
        # Adds nothing, but makes both observations inputs of the model.
        nothing = observation["measurements"].sum(1) * 0.0 + observation["picture"].float().sum((1, 2, 3)) * 0.0
        return self.points[None] + nothing[:, None]

    def facts(self) -> dict[str, str]:
        return {}


def policy(folder: Path, speed: float, left: float = 0.0) -> Path:
    space = Dict({"picture": Box(0, 255, (3, HEIGHT, WIDTH), np.uint8), "measurements": Box(-9, 9, (MEASUREMENTS,))})
    export(Fixed(speed, left), space, folder / "fixed", {})
    return folder / "fixed.onnx"


@pytest.fixture(scope="module")
def at_eight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return policy(tmp_path_factory.mktemp("eight"), 8.0)


def driven(agent: Priboot, scene: Scene, seconds: float) -> np.ndarray:
    return speeds(drive(agent, scene, seconds))


def test_it_drives_at_the_speed_of_its_waypoints(at_eight: Path) -> None:
    assert driven(Priboot(policy=at_eight), straight_road().with_ego(x=50.0), 12.0)[-1] == pytest.approx(8.0, abs=0.8)


def test_waypoints_to_the_left_steer_to_the_left(tmp_path: Path) -> None:
    worlds = drive(Priboot(policy=policy(tmp_path, 4.0, left=0.3)), straight_road().with_ego(x=50.0, speed=4.0), 2.0)
    assert worlds[-1].egos.heading[0] > 0.1


RED_LIGHT = lit_crossing().with_ego(x=-60.0, speed=8.0).with_lights(LightState.RED)
CAR = straight_road().with_ego(x=50.0, speed=8.0).with_actor(100.0, 0.0)
PERSON = straight_road().with_ego(x=50.0, speed=8.0).with_pedestrian(100.0, y=-4.8)
CONES = straight_road().with_ego(x=50.0, speed=8.0).with_actor(100.0, 0.0, kind=ActorKind.STATIC, length=1.0, width=1.0)


@pytest.mark.parametrize("scene", [RED_LIGHT, CAR, PERSON, CONES])
def test_the_rules_stop_it_and_can_be_switched_off(scene: Scene, at_eight: Path) -> None:
    with_rules = drive(Priboot(policy=at_eight), scene, 9.0)
    assert speeds(with_rules)[-1] < 0.1
    assert not any(world.contacts for world in with_rules)
    assert driven(Priboot(rules=False, policy=at_eight), scene, 9.0)[-1] > 6.0


def test_the_rules_do_not_mind_who_is_beside_the_way(at_eight: Path) -> None:
    scene = straight_road().with_ego(x=50.0, speed=8.0).with_actor(100.0, left=2.6)
    assert driven(Priboot(policy=at_eight), scene, 9.0).min() > 6.0


def test_it_creeps_after_a_long_stand_on_a_straight_way(tmp_path: Path) -> None:
    agent = Priboot(policy=policy(tmp_path, 0.0))
    found = driven(agent, straight_road().with_ego(x=50.0), 14.0)
    assert found[:98].max() < 0.1
    assert found[100:].max() > 0.5


def test_it_does_not_creep_up_to_what_stands_ahead(tmp_path: Path) -> None:
    scene = straight_road().with_ego(x=50.0).with_actor(63.0, 0.0)
    assert driven(Priboot(policy=policy(tmp_path, 0.0)), scene, 14.0).max() < 0.1


ROUND_IT = np.array([[4.0, 0.6], [8.0, 1.8], [12.0, 2.8], [16.0, 3.0]])


def verdict(scene: Scene, waypoints: np.ndarray) -> rules.Verdict:
    return rules.judge(observed(Priboot(), scene.world()), float(scene.world().egos.speed[0]), waypoints)


STRAIGHT_ON = np.array([[4.0, 0.0], [8.0, 0.0], [12.0, 0.0], [16.0, 0.0]])


@pytest.mark.parametrize("before_m", [0.5, 4.0, 12.0])
@pytest.mark.parametrize("left", [-3.2, 3.2])
def test_what_stands_beside_the_goal_is_not_in_the_way(before_m: float, left: float) -> None:
    """The sensor `path` repeats the goal, which has no direction; the ego stood before it for good."""
    scene = straight_road().with_ego(x=999.0 - before_m, speed=4.0)
    for x in (994.0, 1000.0, 1005.0):
        scene = scene.with_actor(x, 0.0, left=left)
    assert verdict(scene, STRAIGHT_ON) == rules.FREE
    ahead = scene.with_actor(1001.0, 0.0)
    assert verdict(ahead, STRAIGHT_ON).brake > 0.0, "what stands behind it in the lane is"


@pytest.mark.parametrize("metres", [12.0, 20.0], ids=["beside the waypoints", "behind them"])
def test_what_stands_does_not_stop_waypoints_that_lead_round_it(metres: float) -> None:
    scene = straight_road().with_ego(x=50.0, speed=8.0).with_actor(50.0 + metres, 0.0)
    assert verdict(scene, ROUND_IT) == rules.FREE
    assert verdict(scene, ROUND_IT * (1.0, 0.0)).cause == "vehicle"


def test_it_brakes_for_what_stands_where_there_is_room_to_go_round() -> None:
    ahead = np.array([[4.0, 0.0], [8.0, 0.0], [12.0, 0.0], [16.0, 0.0]])
    scene = straight_road().with_ego(x=50.0, speed=8.0)
    found = verdict(scene.with_actor(69.6), ahead)
    assert 0.3 < found.brake < 0.7
    assert found.cause == "vehicle"
    assert verdict(scene.with_actor(69.6, 8.0), ahead) == rules.FREE, "it drives on"
    assert verdict(straight_road().with_ego(x=50.0, speed=1.0).with_actor(60.0), ahead / 8.0).brake == 0.0, "a queue"


def test_waypoints_round_one_stop_before_another_that_stands_there() -> None:
    scene = straight_road().with_ego(x=50.0, speed=8.0).with_actor(62.0).with_actor(66.0, left=3.0)
    assert verdict(scene, ROUND_IT).cause == "vehicle"


def test_what_moves_on_the_route_stops_waypoints_that_lead_round_it() -> None:
    scene = straight_road().with_ego(x=50.0, speed=8.0).with_actor(58.0, 1.0)
    assert verdict(scene, ROUND_IT).cause == "vehicle"


AHEAD = np.array([[4.0, 0.0], [8.0, 0.0], [12.0, 0.0], [16.0, 0.0]])
AT_EIGHT = straight_road().with_ego(x=50.0, speed=8.0)
LEFT, RIGHT = np.pi / 2, -np.pi / 2


@pytest.mark.parametrize("kind", [ActorKind.PEDESTRIAN, ActorKind.BICYCLE])
def test_it_brakes_for_who_is_about_to_walk_or_cycle_into_its_way(kind: ActorKind) -> None:
    def crossing(speed: float, left: float, heading: float = LEFT) -> rules.Verdict:
        return verdict(
            AT_EIGHT.with_actor(61.0, speed, kind=kind, left=left, heading=heading, length=0.5, width=0.5), AHEAD
        )

    assert crossing(1.8, -3.5).brake == 1.0
    assert crossing(1.8, 3.5) == rules.FREE, "it has crossed"
    assert crossing(1.8, -3.5, RIGHT) == rules.FREE, "it walks away"
    assert crossing(1.8, -3.5, 0.0) == rules.FREE, "it goes along the road"
    assert crossing(0.0, -3.5) == rules.FREE, "it waits"


def test_it_brakes_for_crossing_cars_that_can_no_longer_stop() -> None:
    def crossing(speed: float, left: float) -> rules.Verdict:
        return verdict(AT_EIGHT.with_actor(62.0, speed, left=left, heading=LEFT), AHEAD)

    assert crossing(14.0, -20.0).brake == 1.0
    assert crossing(8.0, -20.0) == rules.FREE, "it can stop"
    assert crossing(14.0, 8.0) == rules.FREE, "it has crossed"


def test_cars_on_the_other_lane_do_not_cross() -> None:
    assert verdict(AT_EIGHT.with_actor(80.0, 14.0, left=3.2, heading=np.pi - 0.1), AHEAD) == rules.FREE


def test_it_brakes_earlier_for_one_that_comes_towards_it() -> None:
    fast, ahead = straight_road().with_ego(x=50.0, speed=14.0), AHEAD * 1.75
    assert verdict(fast.with_actor(90.0, 8.0, heading=np.pi), ahead).brake == 1.0
    assert verdict(fast.with_actor(90.0, 8.0), ahead) == rules.FREE


LEFT_TURN = np.array([[2.5, 0.3], [4.9, 1.2], [7.1, 2.4], [8.9, 4.0]])
LANE_CHANGE = np.array([[4.0, 0.2], [8.0, 0.9], [12.0, 2.0], [16.0, 3.2]])


def test_it_gives_way_to_who_comes_towards_it_where_it_turns_left() -> None:
    def oncoming(x: float, speed: float = 8.0, heading: float = np.pi) -> str:
        return verdict(
            straight_road().with_ego(x=50.0, speed=5.0).with_actor(x, speed, left=3.4, heading=heading), LEFT_TURN
        ).cause

    assert oncoming(76.0) == "foreseen"
    assert oncoming(76.0, 0.0) == "", "it waits"
    assert oncoming(90.0) == "", "it is far away"
    assert oncoming(49.0) == "", "it has passed"
    ahead = verdict(straight_road().with_ego(x=50.0, speed=5.0).with_actor(76.0, 8.0, left=3.4, heading=np.pi), AHEAD)
    assert ahead == rules.FREE, "it does not turn"


def test_it_does_not_change_lanes_into_who_drives_there() -> None:
    def beside(x: float, speed: float) -> str:
        return verdict(AT_EIGHT.with_actor(x, speed, left=3.2), LANE_CHANGE).cause

    assert beside(49.0, 8.0) == "foreseen"
    assert beside(43.0, 11.0) == "foreseen", "it overtakes"
    assert beside(40.0, 8.0) == "", "it is behind and stays there"
    assert verdict(AT_EIGHT.with_actor(49.0, 8.0, left=3.2), AHEAD) == rules.FREE


def test_it_is_told_its_speed_its_limit_its_standstill_and_its_target(at_eight: Path) -> None:
    seen = observed(Priboot(policy=at_eight), straight_road().with_ego(x=50.0, left=1.5, speed=5.0).world())
    told = measured(seen, 120.0)
    assert told[SPEED] == pytest.approx(0.5)
    assert told[LIMIT] == pytest.approx(1.389, abs=0.001)
    assert told[BLOCKED] == pytest.approx(6.0), "no more than a minute"
    assert told[TARGET] * 30.0 == pytest.approx([30.0, -1.5], abs=0.6)


def test_a_policy_of_other_observations_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match="no policy"):
        Priboot(policy=tmp_path / "missing.onnx")


def test_it_can_be_asked_for_a_target_speed_while_another_drives() -> None:
    expert = make_expert("priboot", max_speed=6.0, obey_lights=True, noise=0.0)
    free = straight_road().with_ego(x=50.0, speed=4.0)
    person = free.with_pedestrian(56.0, y=-4.8)
    asked = [expert.advise(one.world(), observed(Priboot(), one.world()))[0] for one in (free, person)]
    assert asked[0] > 3.0
    assert asked[1] < 1.0, "the rules brake"
