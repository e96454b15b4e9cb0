"""Quaternions: the algebra that the filters rely on."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dohyo.agents.localization.filters.attitude import (
    exponential,
    from_heading,
    heading_of,
    inverse,
    logarithm,
    matrix,
    normalised,
    product,
    skew,
)

number = st.floats(-1.0, 1.0)
vector = st.tuples(number, number, number).map(np.array)
quaternion = (
    st.tuples(number, number, number, number).map(np.array).filter(lambda q: np.linalg.norm(q) > 0.1).map(normalised)
)
rotation = (
    st.tuples(vector, st.floats(0.0, 3.1))
    .filter(lambda p: np.linalg.norm(p[0]) > 1e-3)
    .map(lambda pair: pair[0] / np.linalg.norm(pair[0]) * pair[1])
)


@given(quaternion)
def test_a_rotation_matrix_is_orthogonal_and_keeps_hands(q: np.ndarray) -> None:
    R = matrix(q)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)


@given(quaternion, quaternion)
def test_the_product_of_quaternions_is_that_of_their_matrices(p: np.ndarray, q: np.ndarray) -> None:
    np.testing.assert_allclose(matrix(product(p, q)), matrix(p) @ matrix(q), atol=1e-12)


@given(quaternion)
def test_the_inverse_undoes(q: np.ndarray) -> None:
    np.testing.assert_allclose(product(q, inverse(q)), [1, 0, 0, 0], atol=1e-12)


@given(rotation)
def test_exponential_and_logarithm_undo_each_other(turn: np.ndarray) -> None:
    np.testing.assert_allclose(logarithm(exponential(turn)), turn, atol=1e-7)
    assert np.linalg.norm(exponential(turn)) == pytest.approx(1.0)


@given(vector, vector)
def test_a_small_rotation_adds_the_cross_product(turn: np.ndarray, v: np.ndarray) -> None:
    turn = 1e-5 * turn
    np.testing.assert_allclose(matrix(exponential(turn)) @ v, v + np.cross(turn, v), atol=1e-9)
    np.testing.assert_allclose(skew(turn) @ v, np.cross(turn, v), atol=1e-15)


@given(quaternion)
def test_a_quaternion_and_its_negative_turn_alike(q: np.ndarray) -> None:
    np.testing.assert_allclose(matrix(q), matrix(-q), atol=1e-12)
    np.testing.assert_allclose(matrix(exponential(logarithm(q))), matrix(-q), atol=1e-7)


@given(st.floats(-3.1, 3.1))
def test_headings_count_from_east_to_the_left(heading: float) -> None:
    q = from_heading(heading)
    assert heading_of(q) == pytest.approx(heading, abs=1e-9)
    np.testing.assert_allclose(matrix(q)[:, 0], [math.cos(heading), math.sin(heading), 0.0], atol=1e-12)
