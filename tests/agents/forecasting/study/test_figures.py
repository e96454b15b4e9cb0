"""The figure: stages of a congested day, and what stands at which minute."""

from __future__ import annotations

import numpy as np
import pytest

from dohyo.agents.forecasting.data.windows import make_windows
from dohyo.agents.forecasting.registry import make_forecaster
from dohyo.agents.forecasting.study.figures import SHOWN, figure, forecasts, stages
from dohyo.sumo_networks.errors import InvalidInputError
from tests.agents.forecasting.roads import road_stretch


def test_the_stages_of_a_queue_that_grows_and_shrinks() -> None:
    measured = np.full((100, 10), 30.0, dtype=np.float32)
    for row in range(100):
        queue = max(0, round(8 - abs(row - 50) / 4))
        measured[row, :queue] = 5.0
    at = stages(measured, 30.0)
    assert at["free flow"] < at["onset"] < at["congestion"] < at["dissipation"]
    assert abs(at["congestion"] - 50) <= 3
    assert 55 <= at["dissipation"] <= 75
    with pytest.raises(InvalidInputError, match="expected a congested day"):
        stages(np.full((20, 3), 30.0, dtype=np.float32), 30.0)


def test_every_forecast_stands_at_the_minute_it_is_for() -> None:
    windows = make_windows([road_stretch(60, 4)], 60.0)
    now = {name: make_forecaster("persistence", 4) for _, name, _ in SHOWN}
    shown = forecasts(windows, now)
    one, three = shown[SHOWN[0][0]], shown[SHOWN[1][0]]
    np.testing.assert_allclose(three, 3.6 * windows.history[:, -1], rtol=1e-5)  # what was there three minutes before
    np.testing.assert_allclose(one[:-2], 3.6 * windows.history[2:, -1], rtol=1e-5)  # one minute before


def test_the_figure_has_four_maps_and_four_stages() -> None:
    windows = make_windows([road_stretch(200, 8)], 60.0)
    drawn = figure(windows, {name: make_forecaster("persistence", 8) for _, name, _ in SHOWN}, 31.0, "a day")
    kinds = [trace.type for trace in drawn.data]
    assert (kinds.count("heatmap"), kinds.count("scatter")) == (4, 16)
