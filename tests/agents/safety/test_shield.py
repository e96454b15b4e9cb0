"""The shield: what it changes, what it leaves alone, and that it composes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from dohyo.agents.registry import resolve_with
from dohyo.agents.safety.shield import RESPONSES, Shielded
from dohyo.evaluation.agent import AgentSpec, agent_info, make_agent
from dohyo.sumo_networks.ego.control import CONTROLS
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.world import ActorKind
from tests.agents.driving import drive, observed, speeds, touched
from tests.worlds import Scene, straight_road

RECKLESS = "dohyo.agents.experts.reckless:Reckless"
FULL_SPEED: dict[str, Any] = {
    "pedals_steering": [1.0, 0.0, 0.3],
    "acceleration_steering": [2.0, 0.3],
    "target_speed_steering": [20.0, 0.3],
    "waypoints": [[5.0 * i, 0.6 * i] for i in range(1, 9)],
    "lane_command": [20.0, 1.0],
}
"""Faster, and to the left."""


class Blunt:
    """Answers the same whatever it sees."""

    def __init__(self, control: str = "acceleration_steering") -> None:
        self.spec = AgentSpec(name="blunt", track="sensors", sensors=("speedometer",), control=control)
        self.seen: set[str] = set()

    def reset(self, mission: object, seed: int) -> None: ...

    def act(self, observation: dict[str, np.ndarray]) -> np.ndarray:
        self.seen = set(observation)
        return np.array(FULL_SPEED[self.spec.control])

    def explain(self) -> dict[str, Any]:
        return {"why": "blunt"}

    def close(self) -> None: ...


BLUNT = "tests.agents.safety.test_shield:Blunt"


def free_road() -> Scene:
    return straight_road().with_ego(x=50.0, speed=10.0)


def braking_leader() -> Scene:
    """6 m behind somebody of the same speed, who brakes with 6 m/s^2 after a second."""
    return free_road().with_actor(80.0, lambda t: max(10.0 - 6.0 * max(t - 1.0, 0.0), 0.0))


def acted(scene: Scene, control: str) -> np.ndarray:
    agent = Shielded(inner=BLUNT, control=control)
    agent.reset(scene.mission, 0)
    return agent.act(observed(agent, scene.world()))


# What it does to an action


@pytest.mark.parametrize("control", CONTROLS)
def test_on_a_free_road_nothing_is_changed(control: str) -> None:
    assert acted(free_road(), control) == pytest.approx(np.array(FULL_SPEED[control]))


@pytest.mark.parametrize(
    ("control", "expected"),
    [
        # RSS asks for 5 m/s^2 behind who is 6 m ahead and a little slower.
        ("pedals_steering", [0.0, 5.0 / 8.0, 0.3]),
        ("acceleration_steering", [-5.0, 0.3]),
        ("target_speed_steering", [10.0 - 5.0 / 1.6, 0.3]),
        ("lane_command", [10.0 - 5.0 / 1.6, 1.0]),
    ],
)
def test_too_near_behind_somebody_it_brakes_and_lets_the_agent_steer(control: str, expected: list[float]) -> None:
    assert acted(free_road().with_actor(60.5, 8.0), control) == pytest.approx(np.array(expected), abs=0.01)


def test_waypoints_are_drawn_together_on_the_way_they_lead() -> None:
    wanted, answer = np.array(FULL_SPEED["waypoints"]), acted(free_road().with_actor(60.5, 8.0), "waypoints")
    steps = np.hypot(*np.diff(answer[:2], axis=0).T) / 0.5
    assert steps[0] == pytest.approx(10.0 - 5.0 / 1.6, abs=0.05)
    assert answer[:, 1] / answer[:, 0] == pytest.approx(wanted[:, 1] / wanted[:, 0])


@pytest.mark.parametrize("control", CONTROLS)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_beside_somebody_it_does_not_go_nearer_but_may_go_away(control: str, side: float) -> None:
    beside = free_road().with_actor(50.0, 10.0, left=side * 1.95)
    answer, wanted = acted(beside, control), np.array(FULL_SPEED[control])
    last = answer[:, 1] if control == "waypoints" else answer[-1:]
    if side > 0.0:
        assert last == pytest.approx(np.zeros(len(last)), abs=1e-3)
    else:
        assert answer == pytest.approx(wanted)


def test_it_never_makes_an_agent_that_brakes_brake_less() -> None:
    agent = Shielded(inner=BLUNT)
    agent.inner.act = lambda observation: np.array([-7.5, 0.0])  # type: ignore[method-assign]
    scene = free_road().with_actor(60.5, 8.0)
    agent.reset(scene.mission, 0)
    assert agent.act(observed(agent, scene.world())) == pytest.approx([-7.5, 0.0])
    assert agent.interventions == 0


# Drives


def test_reckless_hits_a_braking_leader_and_with_the_shield_does_not() -> None:
    bare, shielded = make_agent(RECKLESS), make_agent(*resolve_with(RECKLESS, {"shield": "rss"}))
    assert touched(drive(bare, braking_leader(), 6.0))
    worlds = drive(shielded, braking_leader(), 6.0)
    assert not touched(worlds)
    assert speeds(worlds)[-1] < 0.5


def test_reckless_with_the_shield_stops_for_who_walks_across() -> None:
    scene = free_road().with_actor(
        85.0, 1.4, kind=ActorKind.PEDESTRIAN, left=-5.0, heading=math.pi / 2, length=0.5, width=0.5
    )
    bare, shielded = make_agent(RECKLESS, {"throttle": 0.1}), Shielded(inner=RECKLESS, throttle=0.1)
    assert touched(drive(bare, scene, 5.0))
    assert not touched(drive(shielded, scene, 5.0))


def test_it_goes_on_when_the_danger_is_over() -> None:
    scene = free_road().with_actor(75.0, lambda t: 0.0 if t < 6.0 else 15.0)
    worlds = drive(Shielded(inner=RECKLESS), scene, 12.0)
    assert speeds(worlds)[55:60].max() < 0.5
    assert speeds(worlds)[-1] > 5.0
    assert not touched(worlds)


# How it is asked for


def test_the_inner_agent_sees_what_it_asked_for_and_no_more() -> None:
    agent = Shielded(inner=BLUNT)
    agent.act(observed(agent, free_road().world()))
    assert agent.inner.seen == {"speedometer"}  # type: ignore[attr-defined]
    assert agent.spec.track == "privileged"
    assert agent.spec.name == "blunt+rss"


def test_every_control_has_a_response() -> None:
    assert set(RESPONSES) == set(CONTROLS)


def test_shield_and_localization_compose_with_the_shield_outside() -> None:
    entry, settings = resolve_with("autopilot", {"shield": "rss", "localization": "es-ekf", "gnss": "gnss_rtk"})
    agent = make_agent(entry, settings)
    assert agent.spec.name == "autopilot+es-ekf+rss"
    assert resolve_with(entry, settings) == (entry, settings)
    alone = make_agent(*resolve_with("autopilot", {"shield": "rss"}))
    assert agent_info(agent, entry).source_sha256 != agent_info(alone, entry).source_sha256


def test_settings_reach_the_inner_agent() -> None:
    agent = make_agent(*resolve_with(RECKLESS, {"shield": "rss-literature", "throttle": 0.25}))
    assert agent.inner.throttle == 0.25  # type: ignore[attr-defined]
    assert agent.spec.name == "reckless+rss-literature"


@pytest.mark.parametrize(
    ("settings", "message"), [({"shield": "rrs"}, "did you mean 'rss'"), ({"inner": "nobody"}, "nobody")]
)
def test_an_unknown_name_is_refused(settings: dict[str, str], message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        Shielded(**settings)


def test_it_says_what_it_did_beside_what_the_agent_says() -> None:
    agent = Shielded(inner=BLUNT)
    scene = free_road().with_actor(60.5, 8.0)
    agent.reset(scene.mission, 0)
    agent.act(observed(agent, scene.world()))
    why = agent.explain()
    assert why is not None
    assert why["why"] == "blunt"
    assert why["rss"]["changed"]
    assert why["rss"]["critical"]
    assert [danger["braking_m_s2"] for danger in why["rss"]["dangers"]] == [5.0]
