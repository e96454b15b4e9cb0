from __future__ import annotations

from dohyo.evaluation.meetings import Meeting, meetings
from dohyo.evaluation.records.mixed import agents_of, drives_of
from dohyo.evaluation.records.specifications import InfractionKind, Status
from dohyo.evaluation.summary import compare, summarise
from tests.evaluation.builders import AGENT, ego, episode, infraction

OTHER = AGENT.model_copy(update={"name": "other"})
HIT_B = infraction(InfractionKind.COLLISION_VEHICLE, actor="b")
HIT_A_CAR = infraction(InfractionKind.COLLISION_VEHICLE, actor="traffic.7")


def test_each_agent_has_its_own_drives_and_exchanged_missions_are_one_pair() -> None:
    here = episode(ego(name="a"), ego(name="b", agent=OTHER, progress_m=500.0))
    there = episode(ego(name="a", agent=OTHER), ego(name="b", progress_m=500.0))
    assert agents_of([here, there]) == [AGENT, OTHER]
    sides = [[one for record in (here, there) if (one := drives_of(agent, record))] for agent in (AGENT, OTHER)]
    assert [[ego.name for record in side for ego in record.egos] for side in sides] == [["a", "b"], ["b", "a"]]
    assert [summarise(side).scores["route_completion"].n for side in sides] == [2, 2]
    found = compare(*sides)["route_completion"].difference
    assert (found.mean, found.n) == (0.0, 1), "both drives are of one scenario and seed"


def test_an_agent_of_two_egos_is_one_agent() -> None:
    record = episode(ego(name="a"), ego(name="b"), ego(name="c", agent=OTHER))
    assert agents_of([record]) == [AGENT, OTHER]
    assert meetings([record]) == [Meeting(0, 1, episodes=1, collisions=0)]


def test_an_episode_is_lost_for_the_agents_of_all_its_egos() -> None:
    record = episode(ego(name="a", status=Status.COMPLETED), ego(name="b", agent=OTHER, status=Status.GRIDLOCK))
    narrowed = drives_of(AGENT, record)
    assert narrowed is not None
    assert narrowed.lost
    assert summarise([narrowed]).episodes == 0
    assert meetings([record]) == []


def test_collisions_of_egos_count_for_the_agents_that_met() -> None:
    record = episode(ego(HIT_B, HIT_A_CAR, name="a"), ego(name="b", agent=OTHER), ego(name="c"))
    assert meetings([record]) == [Meeting(0, 1, episodes=1, collisions=1)]
    assert meetings([episode(ego(name="a"), ego(name="b"))]) == []
