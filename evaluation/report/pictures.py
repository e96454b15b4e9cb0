"""Saves a figure as a page that needs no network, and as a picture beside it if there is a browser.

The picture needs chromium and playwright. A browser that fails costs the picture alone.
"""

from __future__ import annotations

import html
import shutil
import sys
from importlib.util import find_spec
from pathlib import Path

import plotly.graph_objects as go
from plotly.offline import get_plotlyjs

from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import write_atomically

_MARGIN_PX, _SETTLED_MS = 16, 1000


def write_page(drawn: go.Figure, path: Path, title: str) -> list[Path]:
    """Writes a figure of fixed size as a page, and as a PNG of the same name if chromium and playwright are installed.

    Why a browser made no picture is said on standard error; an older picture is removed.

    Args:
        drawn: Figure with a width and a height, px.
        path: Path of the page, *.html; its folder is made.
        title: Title of the page, for the browser's tab.

    Returns:
        The paths of the written files.

    Raises:
        InvalidInputError: The path does not end in .html.
    """
    if path.suffix != ".html":
        raise InvalidInputError(f"expected a page's name that ends in .html, got '{path}'; its picture goes beside it")
    body = drawn.to_html(full_html=False, include_plotlyjs=False, config={"displayModeBar": False})
    head = f'<meta charset="utf-8"><title>{html.escape(title)}</title><script>{get_plotlyjs()}</script>'
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, f'<!doctype html><html lang="en"><head>{head}</head><body>{body}</body></html>'.encode())
    chromium = shutil.which("chromium")
    if chromium is None or find_spec("playwright") is None:
        return [path]
    picture = path.with_suffix(".png")
    size = drawn.layout.width + _MARGIN_PX, drawn.layout.height + _MARGIN_PX
    if (fault := _photograph(chromium, path, picture, *size)) is not None:
        print(f"dohyo: no picture '{picture}': {fault}", file=sys.stderr)
        return [path]
    return [path, picture]


def _photograph(chromium: str, page: Path, picture: Path, width: int, height: int) -> str | None:
    """Saves a page as a picture; the reason if there is none."""
    from playwright.sync_api import Error  # imported only if chromium is installed

    try:
        picture.unlink(missing_ok=True)
        _screenshot(chromium, page, picture, width, height)
    except Error as error:
        first, *_ = error.message.strip().splitlines() or [type(error).__name__]
        return f"chromium did not answer: {first}"
    except OSError as error:
        return str(error)
    return None


def _screenshot(chromium: str, page: Path, picture: Path, width: int, height: int) -> None:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox", "--disable-gpu"])
        tab = browser.new_page(viewport={"width": width, "height": height})
        tab.goto(page.resolve().as_uri())
        tab.wait_for_selector(".main-svg")
        tab.wait_for_timeout(_SETTLED_MS)
        tab.screenshot(path=picture)
        browser.close()
