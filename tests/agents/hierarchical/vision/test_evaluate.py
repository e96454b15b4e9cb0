"""How good an autoencoder is, on pictures small enough to count."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from PIL import Image

from dohyo.agents.hierarchical.vision.classes import CLASSES, Seen
from dohyo.agents.hierarchical.vision.evaluate import confusion, intersection_over_union, judge, mean_interval
from dohyo.agents.hierarchical.vision.figure import COLOURS, chosen, draw
from dohyo.agents.hierarchical.vision.network import Autoencoder
from tests.agents.hierarchical.vision.weights import pictures


def test_intersection_over_union_by_hand():
    true = np.array([[Seen.ROAD, Seen.ROAD, Seen.ROAD, Seen.VEHICLE]])
    rebuilt = np.array([[Seen.ROAD, Seen.ROAD, Seen.VEHICLE, Seen.VEHICLE]])
    counts = confusion(rebuilt, true)
    assert counts.sum() == 4
    assert counts[Seen.ROAD, Seen.VEHICLE] == 1
    iou = intersection_over_union(counts)
    assert iou[Seen.ROAD] == pytest.approx(2 / 3)
    assert iou[Seen.VEHICLE] == pytest.approx(1 / 2)
    assert np.isnan(np.delete(iou, [Seen.ROAD, Seen.VEHICLE])).all()


def test_a_constant_predictor_is_judged_by_its_median():
    torch.manual_seed(0)
    shown = pictures(6)
    result = judge(Autoencoder(8).eval(), shown, np.array([40.0, 20.0]))
    assert result["pictures"] == 6
    assert result["impact_constant_mae_m"][0] == pytest.approx(np.abs(shown.impact_m - 40.0).mean(), abs=1e-3)
    assert result["event_constant_mae_m"] == [0.0, 0.0, 0.0]
    assert result["signal_most_frequent"] == 0.5
    assert sum(result["share"].values()) == pytest.approx(1.0)
    assert 0.0 <= result["pixels_right"] <= 1.0


def test_an_interval_holds_the_mean_and_narrows():
    values = np.random.default_rng(0).normal(5.0, 1.0, 2000)
    mean, low, high = mean_interval(values)
    assert low < mean < high
    assert mean == pytest.approx(5.0, abs=0.1)
    assert high - low < mean_interval(values[:50])[2] - mean_interval(values[:50])[1]


def test_the_figure_is_drawn_from_both_splits(tmp_path):
    torch.manual_seed(0)
    draw(Autoencoder(8).eval(), {"validation": pictures(8), "test": pictures(8, 50)}, tmp_path / "x.png")
    with Image.open(tmp_path / "x.png") as drawn:
        colours = {tuple(colour) for colour in np.asarray(drawn).reshape(-1, 3)[::7]}
    assert {COLOURS[Seen.ROAD], COLOURS[Seen.VEHICLE], COLOURS[Seen.RED]} <= colours
    assert len(COLOURS) == CLASSES == len(set(COLOURS.values()))
    rows = chosen(pictures(8))
    assert rows == sorted(set(rows))
    assert [row // 2 for row in rows] == [0, 1, 2, 3], "one of each quarter"
