"""The agent that drives by rules alone: hand-made drives, what it explains, and one drive in traffic."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from dohyo.agents.rules.rulebook import RuleError
from dohyo.agents.rules.rules_only import RULES, RulesOnly, advised_speed, follow
from dohyo.evaluation.agent import agent_info, make_agent
from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.evaluation.episode.runner import run_episode
from dohyo.evaluation.records.specifications import Status
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.world import ActorKind, LightState, World
from tests.agents.driving import brakes_for_a_second_stop_sign, drive, fronts, observed, speeds, touched
from tests.worlds import Scene, lit_crossing, stop_sign_crossing, straight_road

WEST, NORTH = math.pi, math.pi / 2
ENTRY = "dohyo.agents.rules.rules_only:RulesOnly"


@pytest.fixture(scope="module")
def agent() -> RulesOnly:
    return RulesOnly()


def ego(speed: float = 8.0) -> Scene:
    return straight_road().with_ego(x=100.0, speed=speed)


def lefts(worlds: list[World]) -> np.ndarray:
    return np.array([world.egos.lateral[0] for world in worlds])


def acted(agent: RulesOnly, scene: Scene) -> np.ndarray:
    agent.reset(scene.mission, 0)
    return agent.act(observed(agent, scene.world()))


# Drives


def test_on_a_free_road_it_drives_as_fast_as_is_allowed(agent: RulesOnly) -> None:
    worlds = drive(agent, ego(0.0), 20.0)
    assert speeds(worlds)[-1] == pytest.approx(13.89, abs=0.7)
    assert np.abs(lefts(worlds)).max() < 0.1


def test_it_stops_before_a_red_light_and_goes_on_when_it_is_green(agent: RulesOnly) -> None:
    light = lambda t: LightState.RED if t < 12.0 else LightState.GREEN  # noqa: E731
    scene = lit_crossing().with_ego(x=-70.0, speed=8.0).with_lights(light)
    worlds = drive(agent, scene, 18.0)
    line = scene.stop_line("w_c_0")
    assert fronts(worlds)[119] == pytest.approx(line - 1.2, abs=1.1)
    assert speeds(worlds)[119] < 0.1
    assert fronts(worlds)[-1] > line + 5.0


def test_it_stands_once_at_a_stop_sign(agent: RulesOnly) -> None:
    scene = stop_sign_crossing().with_ego(x=-40.0, speed=8.0)
    worlds = drive(agent, scene, 20.0)
    assert speeds(worlds).min() < 0.05
    assert fronts(worlds)[-1] > scene.stop_line("w_c_0") + 10.0


def test_it_brakes_for_a_stop_sign_behind_the_next_junction_until_it_has_stood_there(agent: RulesOnly) -> None:
    assert brakes_for_a_second_stop_sign(agent, ego(8.0)) == [True, False, False]


def test_it_stops_for_what_appears_ahead_and_goes_on_when_it_is_gone(agent: RulesOnly) -> None:
    # 30 m ahead, for 10 s; then it leaves faster than the ego could follow.
    scene = ego(10.0).with_actor(132.0, lambda t: 0.0 if t < 10.0 else 25.0)
    worlds = drive(agent, scene, 16.0)
    assert not touched(worlds)
    assert speeds(worlds)[90] < 0.1
    assert speeds(worlds)[-1] > 5.0


def test_it_brakes_for_a_leader_who_brakes_hard(agent: RulesOnly) -> None:
    scene = ego(12.0).with_actor(122.0, lambda t: max(12.0 - 7.0 * max(t - 2.0, 0.0), 0.0))
    worlds = drive(agent, scene, 9.0)
    assert not touched(worlds)
    assert speeds(worlds)[-1] < 0.1


def test_it_goes_round_a_building_site_and_comes_back(agent: RulesOnly) -> None:
    scene = ego().with_actor(160.0, kind=ActorKind.STATIC, length=6.0, width=2.4)
    worlds = drive(agent, scene, 16.0)
    assert not touched(worlds)
    assert lefts(worlds).max() == pytest.approx(3.2, abs=0.4)
    assert abs(lefts(worlds)[-1]) < 0.3
    assert fronts(worlds)[-1] > 190.0


def test_it_stands_with_room_to_turn_out_and_goes_round_who_has_stood_for_long(agent: RulesOnly) -> None:
    worlds = drive(agent, ego().with_actor(140.0, 0.0), 58.0)
    assert not touched(worlds)
    assert fronts(worlds)[400] == pytest.approx(140.0 - 2.25 - 9.0, abs=1.5)
    assert fronts(worlds)[-1] > 150.0


def test_it_waits_where_the_way_round_is_not_free(agent: RulesOnly) -> None:
    scene = ego().with_actor(160.0, kind=ActorKind.STATIC, length=6.0, width=2.4)
    for x in range(60, 260, 20):
        scene = scene.with_actor(float(x), 0.0, left=3.2)
    worlds = drive(agent, scene, 12.0)
    assert not touched(worlds)
    assert np.abs(lefts(worlds)).max() < 0.3
    assert fronts(worlds)[-1] < 157.0


def test_it_keeps_right_for_who_comes_over_the_middle_until_he_is_past(agent: RulesOnly) -> None:
    # In the left lane of the ego's side, its right side 0.7 m left of the middle of the ego's lane.
    scene = ego().with_actor(180.0, 8.0, left=1.6, heading=WEST)
    worlds = drive(agent, scene, 9.0)
    meets = next(i for i, world in enumerate(worlds) if world.actors.position[0, 0] < fronts(worlds)[i])
    assert not touched(worlds)
    assert lefts(worlds)[meets] < -0.3
    assert np.diff(lefts(worlds)[: meets - 5]).max() < 0.02
    assert abs(lefts(worlds)[-1]) < 0.2


def test_it_lets_somebody_on_foot_walk_across(agent: RulesOnly) -> None:
    scene = ego(10.0).with_actor(140.0, 1.4, kind=ActorKind.PEDESTRIAN, left=-6.0, heading=NORTH, length=0.5, width=0.5)
    worlds = drive(agent, scene, 12.0)
    assert not touched(worlds)
    assert speeds(worlds).min() < 5.0
    assert fronts(worlds)[-1] > 150.0


def test_it_gives_way_to_whoever_has_the_right_of_way(agent: RulesOnly) -> None:
    scene = stop_sign_crossing().with_ego(x=-18.0, speed=0.0).with_actor(4.8, 10.0, y=-50.0, heading=NORTH)
    worlds = drive(agent, scene, 12.0)
    assert not touched(worlds)
    assert fronts(worlds)[-1] > 0.0


# What it says


def test_it_explains_facts_answer_set_and_fired_rules_as_json(agent: RulesOnly) -> None:
    acted(agent, ego().with_actor(115.0, 2.0))
    why = json.loads(json.dumps(agent.explain()))
    assert "speed(80)" in why["facts"]
    assert any(text.startswith("follow(") for text in why["actions"])
    rules = {one["rule"].split(":")[0] for one in why["fired"]}
    assert {"avoidance.lp", "braking.lp", "actions.lp"} <= rules
    assert all(one["text"] for one in why["fired"])
    assert why["rss"]["critical"]
    assert why["rulebook"] == agent.solver.rulebook.version[:12]


def test_it_has_nothing_to_explain_before_it_decides() -> None:
    assert RulesOnly().explain() is None


def test_the_same_observation_gives_the_same_action(agent: RulesOnly) -> None:
    scene = ego().with_actor(118.0, 2.0).with_actor(90.0, 9.0, left=3.2)
    first, again = acted(agent, scene), acted(RulesOnly(), scene)
    assert first.tolist() == again.tolist()
    drive(agent, ego(0.0).with_actor(110.0), 3.0)
    assert acted(agent, scene).tolist() == first.tolist()


def test_an_ego_that_has_to_wait_goes_on_waiting_between_decisions_until_it_drives(agent: RulesOnly) -> None:
    scene = ego(0.0).with_actor(108.0, 1.4, kind=ActorKind.PEDESTRIAN, left=-4.0, heading=NORTH, length=0.5, width=0.5)

    def waited_after(*speeds: float) -> bool:
        """Whether it has waited for 2 s by the tick after another agent drove at these speeds."""
        acted(agent, scene)
        observation = observed(agent, scene.world())
        for speed in speeds:
            agent.observe({**observation, "speedometer": np.array([speed], dtype=np.float32)})
        agent.act(observation)
        why = agent.explain()
        assert why is not None
        return "refused(20)" in why["facts"]

    assert waited_after(*[0.0] * 19)
    assert not waited_after(*[0.0] * 18, 5.0)
    assert not waited_after(5.0, *[0.0] * 18)


# Its rules are data


def test_another_rulebook_drives_differently_and_is_another_agent(tmp_path: Path, agent: RulesOnly) -> None:
    for file in RULES.glob("*.lp"):
        (tmp_path / file.name).write_text(file.read_text())
    (tmp_path / "careful.lp").write_text("% Never faster than 30 km/h.\npace(83) :- speed(_).\n")
    careful = RulesOnly(rules=str(tmp_path))
    assert speeds(drive(careful, ego(0.0), 15.0))[-1] == pytest.approx(8.3, abs=0.5)
    assert agent_info(careful, ENTRY).files_sha256 != agent_info(agent, ENTRY).files_sha256


def test_a_broken_rulebook_is_refused_before_any_drive(tmp_path: Path) -> None:
    (tmp_path / "broken.lp").write_text("go :- fast.\n")
    with pytest.raises(RuleError, match=r"^broken\.lp:1: unknown predicate 'fast/0'"):
        RulesOnly(rules=tmp_path)
    with pytest.raises(InvalidInputError, match=r"broken\.lp:1: unknown predicate"):
        make_agent(ENTRY, {"rules": str(tmp_path)})


@pytest.mark.parametrize(
    ("rule", "message"),
    [
        ("#show honk/0.\nhonk :- speed(_).\n", r"^more\.lp:1: expected an order of .*, got 'honk/0'"),
        ("follow(99) :- speed(_).\n", r"order 'follow\(99\)': expected the key of an actor ahead"),
        ("change(up) :- speed(_).\n", r"order 'change\(up\)': expected own, or a lane beside"),
    ],
)
def test_an_order_that_cannot_be_carried_out_is_told(tmp_path: Path, rule: str, message: str) -> None:
    for file in RULES.glob("*.lp"):
        (tmp_path / file.name).write_text(file.read_text())
    (tmp_path / "more.lp").write_text(rule)
    with pytest.raises(RuleError, match=message):
        acted(RulesOnly(rules=tmp_path), ego())


def test_unknown_constants_are_refused() -> None:
    with pytest.raises(InvalidInputError, match="RSS constants"):
        RulesOnly(rss="none")


# The control below the rules


def test_following_stands_at_the_gap_and_closes_a_larger_one() -> None:
    assert follow(0.0, 2.5, 0.0) == pytest.approx(0.0)
    assert follow(0.0, 5.0, 0.0) > 0.5
    assert follow(10.0, 5.0, 0.0) == -5.0


def test_the_advised_speed_foresees_limits_and_curves() -> None:
    route = np.zeros((80, 7), dtype=np.float32)
    route[:, 4] = 13.0
    assert advised_speed(route) == pytest.approx(13.0)
    route[20:, 4] = 5.0
    # 5^2 + 2 x 1.75 x 20 = 95
    assert advised_speed(route) == pytest.approx(math.sqrt(95.0))
    route[:, 4], route[10:, 3] = 13.0, 0.1
    # 2 / 0.1 + 2 x 1.75 x 10 = 55
    assert advised_speed(route) == pytest.approx(math.sqrt(55.0))


@pytest.mark.slow
def test_it_stops_and_resumes_in_the_obstacle_test() -> None:
    benchmark = load_benchmark("obstacles")
    scenarios = [s for s in benchmark.scenarios(benchmark.seeds) if s.name in ("vehicle.town-train.m01",)]
    (scenario,) = scenarios
    record = run_episode(scenario, {scenario.missions[0].name: RulesOnly()})
    assert record.egos[0].status == Status.PERFECT
    assert record.egos[0].contacts == 0
