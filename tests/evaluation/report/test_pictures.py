"""A figure on disk: a page that holds all it needs, and a picture where there is a chromium."""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import plotly.graph_objects as go
import pytest

from dohyo.evaluation.report.pictures import write_page
from dohyo.sumo_networks.errors import InvalidInputError


def square() -> go.Figure:
    lines = go.Scatter(x=[0, 1], y=[0, 1], mode="lines", line={"color": "#0000FF", "width": 40})
    return go.Figure(lines, layout={"width": 300, "height": 200, "margin": dict.fromkeys("lrtb", 0)})


def test_the_page_needs_no_network(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda name: None)
    page = tmp_path / "new" / "page.html"
    assert write_page(square(), page, "<a> & b") == [page]
    text = page.read_text()
    assert "<title>&lt;a&gt; &amp; b</title>" in text
    assert "Plotly.newPlot" in text
    assert "<script src" not in text


def test_a_page_is_not_written_under_the_name_of_a_picture(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match=r"expected a page's name that ends in .html, got '.*curves.png'"):
        write_page(square(), tmp_path / "curves.png", "square")
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(shutil.which("chromium") is None, reason="no chromium")
def test_the_picture_shows_the_figure_whole(tmp_path: Path) -> None:
    _, picture = write_page(square(), tmp_path / "page.html", "square")
    pixels = cv2.imread(str(picture))
    assert pixels.shape == (216, 316, 3)
    assert ((pixels[..., 0] > 200) & (pixels[..., 2] < 50)).mean() > 0.05  # the blue line


def test_a_browser_that_fails_costs_the_picture_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    chromium, page = tmp_path / "bin" / "chromium", tmp_path / "page.html"
    chromium.parent.mkdir()
    chromium.write_text("#!/bin/sh\nexit 1\n")
    chromium.chmod(0o755)
    monkeypatch.setenv("PATH", str(chromium.parent), prepend=":")
    page.with_suffix(".png").write_bytes(b"of an older page")
    assert write_page(square(), page, "square") == [page]
    assert not page.with_suffix(".png").exists()
    (told,) = capsys.readouterr().err.splitlines()
    assert told.startswith(f"dohyo: no picture '{page.with_suffix('.png')}': chromium did not answer: ")
