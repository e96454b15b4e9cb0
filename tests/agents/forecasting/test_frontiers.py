"""Frontiers: what counts as one, the states that follow from them, and what a network learns of a moving jam."""

from __future__ import annotations

from itertools import product

import numpy as np

from dohyo.agents.forecasting.data.speed_table import Stretch
from dohyo.agents.forecasting.data.windows import Windows, make_windows
from dohyo.agents.forecasting.frontiers import Frontiers, congested, frontiers, known, most_probable
from dohyo.agents.forecasting.registry import make_forecaster
from dohyo.agents.forecasting.scores import errors, frontier_scores, frontiers_ahead
from dohyo.agents.forecasting.simple import Persistence
from dohyo.agents.forecasting.training import TrainSettings
from dohyo.sumo_networks.arrays import BoolArray, FloatArray
from tests.agents.forecasting.roads import jam_that_grows

FREE, N = 30.0, 12


def states(text: str) -> BoolArray:
    return np.array([letter == "#" for letter in text])


def windows(*seeds: int) -> Windows:
    return make_windows([jam_that_grows(seed) for seed in seeds], 60.0)


def brute_force(log_odds: FloatArray, now: BoolArray, hold: float) -> BoolArray:
    def score(some: BoolArray) -> float:
        return float(log_odds[frontiers(some)].sum() + hold * (some == now).sum())

    return max((np.array(some) for some in product((False, True), repeat=len(now))), key=score)


def test_a_frontier_is_where_the_state_changes_and_traffic_arrives_freely() -> None:
    assert frontiers(states("..##.#")).tolist() == states("..#.##").tolist()
    assert frontiers(states("##....")).tolist() == states("#.#...").tolist()
    slow = congested(np.array([[30.0, 17.9, 18.0, np.nan]], np.float32), 30.0)
    assert slow.tolist() == [[False, True, False, False]]


def test_a_frontier_is_known_if_both_speeds_are() -> None:
    assert known(np.array([5.0, np.nan, 5.0, 5.0], np.float32)).tolist() == [True, False, False, True]


def test_the_most_probable_states_are_those_of_an_exhaustive_search() -> None:
    rng = np.random.default_rng(0)
    log_odds, now = rng.normal(0.0, 3.0, (200, 7)), rng.random((200, 7)) < 0.4
    for hold in (0.0, 1.0, 4.0):
        found = most_probable(log_odds.astype(np.float32), now, hold)
        wanted = [brute_force(*some, hold) for some in zip(log_odds.astype(np.float32), now, strict=True)]
        np.testing.assert_array_equal(found, wanted)


def test_one_missed_frontier_does_not_turn_the_rest_of_the_road() -> None:
    now = states("....####")
    log_odds = np.where(frontiers(now), 3.0, -3.0)
    log_odds[2] = 3.0  # a queue that seems to begin twice
    found = most_probable(log_odds[None].astype(np.float32), now[None], 2.0)
    assert found[0, 4:].all()


def test_it_expects_the_queue_to_grow_where_persistence_does_not() -> None:
    train, validation, test = windows(*range(8)), windows(8, 9), windows(10, 11)
    one = make_forecaster("frontiers", N, 60.0, TrainSettings(steps=60))
    assert isinstance(one, Frontiers)
    one.fit(train, validation)
    here, there = (
        frontier_scores(frontiers_ahead(some, test, FREE), test, FREE)["frontier_f1"].mean(axis=0)
        for some in (one, Persistence(N))
    )
    assert here[2] > there[2] + 10.0
    assert errors(one, test, FREE).squared.mean() < errors(Persistence(N), test, FREE).squared.mean()


def test_scores_of_frontiers_are_those_of_a_count() -> None:
    some = windows(3)
    ahead = frontiers(congested(some.target, FREE))
    perfect = frontier_scores(ahead, some, FREE)
    assert all(np.allclose(table, 100.0) for table in perfect.values())
    nothing = frontier_scores(np.zeros_like(ahead), some, FREE)
    assert np.allclose(nothing["frontier_recall"], 0.0)
    assert np.isnan(nothing["frontier_precision"]).all()
    everything = frontier_scores(np.ones_like(ahead), some, FREE)
    assert np.allclose(everything["frontier_precision"], 100.0 * ahead.mean(axis=(0, 2)))


def test_a_road_without_congestion_keeps_its_speeds() -> None:
    free = make_windows([Stretch("x", 0.0, np.full((60, N), 30.0, np.float32))], 60.0)
    one = Frontiers(N, 60.0, TrainSettings(steps=2))
    one.fit(free, free)
    np.testing.assert_allclose(one.predict(free.history[0]), 30.0, atol=1e-4)
