"""The freeway's axis: its segments, its lanes counted from the left, its ramps."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.freeway.road import load_freeway

ROAD = load_freeway()


def test_it_has_the_segments_of_the_thesis() -> None:
    assert ROAD.segments == 21
    assert ROAD.bounds_m[0] == 0.0
    assert ROAD.bounds_m[-1] == pytest.approx(11_400, abs=5)
    assert ROAD.lengths_m.mean() == pytest.approx(543, abs=1)
    assert ROAD.start_m < -1000 < 12_000 < ROAD.end_m


def test_four_lanes_everywhere_but_on_the_bridge() -> None:
    assert [place for place, lanes in enumerate(ROAD.lanes) if lanes == 3] == [16, 17]
    assert {lanes for place, lanes in enumerate(ROAD.lanes) if place not in (16, 17)} == {4}
    assert ROAD.bottleneck_m == ROAD.bounds_m[16]


def test_a_lane_keeps_its_number_where_ramps_add_and_the_bridge_takes_one() -> None:
    """SUMO counts from the right, so its numbers shift at every ramp; ours must not: cars go straight on."""
    links = ROAD.network.connections
    ids = ROAD.network.lanes.ids
    checked = 0
    for source, target in zip(links.source, links.target, strict=True):
        before, after = ROAD.tracks.get(str(ids[source])), ROAD.tracks.get(str(ids[target]))
        if before is None or after is None:
            continue
        end_m = before.start_m + float(ROAD.network.lanes.length[source])
        assert after.start_m == pytest.approx(end_m, abs=1.5)
        assert after.lane == before.lane or str(ids[source]).startswith(("m17", ":after_m17"))  # a lane opens
        checked += 1
    assert checked > 100


@pytest.mark.parametrize("entry", range(4))
def test_every_way_is_one_that_can_be_driven(entry: int) -> None:
    edges = ROAD.network.lanes.edge_ids[ROAD.network.lanes.edge]
    links = ROAD.network.connections
    follows: dict[str, set[str]] = {}
    for source, target in zip(links.source, links.target, strict=True):
        follows.setdefault(str(edges[source]), set()).add(str(edges[target]))
    for exit in range(5):
        if ROAD.joins_m[entry] >= ROAD.leaves_m[exit]:
            with pytest.raises(InvalidInputError, match=f"exit {exit} does not lie downstream of entry {entry}"):
                ROAD.way(entry, exit)
            continue
        way = ROAD.way(entry, exit)
        for edge, after in itertools.pairwise(way):
            reached = {last for inside in follows[edge] for last in follows.get(inside, set())} | follows[edge]
            assert after in reached, (edge, after)


def test_positions_are_found_on_their_edge() -> None:
    assert ROAD.edge_at(0.0) == ("m00", 0.0)
    edge, along = ROAD.edge_at(ROAD.bounds_m[5] + 10)
    assert (edge, round(along)) == ("m05_merge", 10)
    assert np.all(np.diff(ROAD.bounds_m) > 400)


def test_a_town_is_no_freeway() -> None:
    with pytest.raises(InvalidInputError, match=r"network 'town-train' is no freeway: expected 'mainline\.toml'"):
        load_freeway("town-train")
