"""Localization scores by hand."""

from __future__ import annotations

import numpy as np
import pytest

from dohyo.evaluation.scores.localization import accuracy, errors, max_drift, p95, rmse
from dohyo.sumo_networks.errors import InvalidInputError

TRUE = np.zeros((4, 2))
OFF = np.array([[0.3, 0.4], [0.0, 0.0], [3.0, 4.0], [0.0, -0.51]])


def test_four_samples_by_hand() -> None:
    np.testing.assert_allclose(errors(OFF, TRUE), [0.5, 0.0, 5.0, 0.51])
    assert accuracy(OFF, TRUE) == 50.0  # 0.5 m counts as right
    assert accuracy(OFF, TRUE, within_m=1.0) == 75.0
    assert rmse(OFF, TRUE) == pytest.approx(np.sqrt((0.25 + 25.0 + 0.2601) / 4))
    assert max_drift(OFF, TRUE) == 5.0


def test_95_percent_keep_within_p95() -> None:
    track = np.column_stack([np.linspace(0.0, 1.0, 1001), np.zeros(1001)])
    assert p95(track, np.zeros((1001, 2))) == pytest.approx(0.95)


@pytest.mark.parametrize(
    ("estimated", "true"),
    [(OFF, TRUE[:3]), (np.zeros((0, 2)), np.zeros((0, 2))), (np.zeros((4, 3)), np.zeros((4, 3))), (OFF * np.nan, TRUE)],
)
def test_what_cannot_be_compared_is_refused(estimated: np.ndarray, true: np.ndarray) -> None:
    with pytest.raises(InvalidInputError):
        rmse(estimated, true)
