"""The figure of decision times, from results alone."""

from __future__ import annotations

import json

import pytest

from dohyo.agents.mcts.study.speed import RESULTS, WAYS, draw
from dohyo.sumo_networks.errors import InvalidInputError


def result(ms: float) -> dict[str, float]:
    return {"median_ms": ms, "p99_ms": 2 * ms, "cpu_median_ms": ms, "cpu_p99_ms": 1.5 * ms}


def test_it_tells_what_was_measured() -> None:
    rows = {way: {"64": result(2.0 + i), "256": result(8.0 + i)} for i, way in enumerate(WAYS)}
    figure = draw({"by_simulations": rows, "by_actors": rows})
    assert "takes 8.0 ms (12.0 at" in figure.layout.title.text
    lines = [trace for trace in figure.data if trace.mode == "lines+markers"]
    assert [list(line.y) for line in lines] == [[2.0, 8.0], [3.0, 9.0], [4.0, 10.0]] * 2
    assert {line.name for line in lines} == set(WAYS.values())
    shades = [trace for trace in figure.data if trace.fill == "toself"]
    assert list(shades[0].y) == [3.0, 12.0, 8.0, 2.0]  # up along the 99th percentile, back along the median


def test_the_shipped_results_can_be_drawn_and_others_are_refused() -> None:
    draw(json.loads(RESULTS.read_text()))
    with pytest.raises(InvalidInputError, match="by_simulations"):
        draw({"by_actors": {}})
    with pytest.raises(InvalidInputError, match="planners"):
        draw({"by_simulations": {"learned": {"64": result(1.0)}}, "by_actors": {}})
