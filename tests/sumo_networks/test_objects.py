"""Tables of moving things: rows taken, tables joined, in every table that derives from the first."""

from __future__ import annotations

import numpy as np
import pytest

from dohyo.sumo_networks.objects import ObjectStates
from dohyo.sumo_networks.world import Actors


def actors(*keys: int) -> Actors:
    number = np.array(keys, dtype=np.int64)
    far = number.astype(float)
    return Actors(
        key=number,
        kind=number % 3,
        position=np.column_stack([far, -far]),
        heading=far / 10,
        speed=far + 1,
        length=far + 2,
        width=far + 3,
        lane=number * 2,
        indicator=np.sign(number - 1),
    )


def test_a_box_is_its_centre_its_heading_and_its_size() -> None:
    assert actors(0, 4).boxes().tolist() == [[0, 0, 0, 2, 3], [4, -4, 0.4, 6, 7]]


@pytest.mark.parametrize("rows", [np.array([2, 0]), np.array([True, False, True])])
def test_taken_rows_keep_all_their_columns(rows: np.ndarray) -> None:
    some = actors(5, 6, 7).take(rows)
    assert isinstance(some, Actors)
    assert some.key.tolist() == ([7, 5] if rows.dtype != np.bool_ else [5, 7])
    assert some.lane.tolist() == (2 * some.key).tolist()
    assert some.position[:, 0].tolist() == some.key.tolist()


def test_joined_tables_follow_each_other() -> None:
    whole = Actors.concat([actors(3, 1), Actors.empty(), actors(2)])
    for name in ("key", "kind", "position", "heading", "speed", "length", "width", "lane", "indicator"):
        np.testing.assert_array_equal(getattr(whole, name), getattr(actors(3, 1, 2), name))


def test_an_empty_table_has_columns_of_the_right_shape() -> None:
    none = ObjectStates.empty()
    assert len(none) == 0
    assert none.boxes().shape == (0, 5)
    assert Actors.empty().key.dtype == np.int64
