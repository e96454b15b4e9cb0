"""The external actors of a world between two ticks."""

from __future__ import annotations

import tracemalloc

from dohyo.service.simulating.actors import ActorChange, ActorRow, WorldActors


def cars(*names: str) -> list[ActorRow]:
    """Cars that stand."""
    return [ActorRow(name, "car", 0.0, 0.0) for name in names]


def test_a_tick_is_told_of_what_it_has_and_of_what_the_one_before_had() -> None:
    actors = WorldActors()
    actors.change("b", ActorChange(cars("z", "a")))
    actors.change("a", ActorChange(cars("m", "passing")))
    actors.change("a", ActorChange(remove=["passing"]))
    told = actors.changed()
    assert ([row.name for row in told.put], told.remove) == (["m", "z", "a"], []), "workers in order, then their rows"
    actors.change("b", ActorChange(remove=["z", "a"]))
    actors.change("a", ActorChange(cars("a")))
    actors.forget("b")
    told = actors.changed()
    assert ([row.name for row in told.put], told.remove) == (["a"], ["z"]), "it was b's, and is a's"


def test_actors_that_no_tick_has_shown_leave_nothing_behind() -> None:
    actors = WorldActors()
    tracemalloc.start()
    try:
        for turn in range(20):
            names = [f"{turn}-{i}" for i in range(1000)]
            actors.change("", ActorChange(cars(*names)))
            actors.change("", ActorChange(remove=names))
        kept = tracemalloc.get_traced_memory()[0]
    finally:
        tracemalloc.stop()
    assert kept < 500_000, "bytes; these names take 3.5 MB"
