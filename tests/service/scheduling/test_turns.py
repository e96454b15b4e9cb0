"""Turns: fair by used processor seconds, whatever owners ask for."""

from __future__ import annotations

from dataclasses import dataclass

from hypothesis import given
from hypothesis import strategies as st

from dohyo.service.scheduling.turns import Turns


@dataclass(frozen=True)
class Order:
    owner: str
    number: int


def serve(turns: Turns, candidates: list[Order], seconds: float = 10.0) -> Order:
    chosen = turns.next(candidates)
    turns.begin(chosen.owner)
    turns.end(chosen.owner, seconds)
    return chosen


@given(st.dictionaries(st.sampled_from("abcde"), st.integers(1, 4), min_size=1), st.integers(1, 40))
def test_owners_take_turns_however_much_they_ask_for(asked: dict[str, int], rounds: int) -> None:
    candidates = [Order(owner, number) for number in range(4) for owner in asked if number < asked[owner]]
    turns = Turns()
    served = [serve(turns, candidates) for _ in range(rounds)]
    counts = [sum(one.owner == owner for one in served) for owner in asked]
    assert max(counts) - min(counts) <= 1
    assert all(one.number == 0 for one in served), "an owner's oldest order is served first"


@given(st.lists(st.floats(0.1, 100.0), min_size=2, max_size=4))
def test_used_seconds_are_shared_equally_whatever_one_turn_takes(costs: list[float]) -> None:
    turns, used = Turns(), [0.0] * len(costs)
    for _ in range(200):
        chosen = turns.next([Order(str(i), i) for i in range(len(costs))])
        turns.begin(chosen.owner)
        turns.end(chosen.owner, costs[chosen.number])
        used[chosen.number] += costs[chosen.number]
    assert max(used) - min(used) <= 2 * max(costs)


def test_a_newcomer_is_served_next_but_idle_time_earns_nothing() -> None:
    turns = Turns()
    for _ in range(100):
        serve(turns, [Order("busy", 0)])
    both = [Order("busy", 0), Order("new", 0)]
    served = [serve(turns, both).owner for _ in range(6)]
    assert served == ["new", "busy"] * 3


def test_an_owner_with_turns_that_run_is_charged_for_them_at_once() -> None:
    turns, both = Turns(), [Order("hog", 0), Order("other", 0)]
    turns.next(both)
    for _ in range(3):
        turns.begin("hog")
    for _ in range(3):
        assert turns.next(both).owner == "other"
        turns.begin("other")
