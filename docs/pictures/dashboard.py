"""Pictures of the dashboard for the README: serves a fresh folder, evaluates two agents, and opens a real browser.

Run it with `.venv/bin/python docs/pictures/dashboard.py` (some minutes; needs chromium).
"""

from __future__ import annotations

import contextlib
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import httpx
from PIL import Image
from playwright.sync_api import Page, sync_playwright

from dohyo.service.client.client import Client

DOCS = Path(__file__).parent
AGENTS = ("autopilot", "reckless")
SCENARIO, SEED = "right-to-south", 0
WIDTH, HEIGHT = 1280, 720
START_S, DRIVE_S = 60.0, 1800.0


@contextlib.contextmanager
def service(data: Path) -> Iterator[httpx.Client]:
    """A running service on a free port, as its administrator."""
    command = [str(Path(sys.executable).with_name("dohyo")), "serve", "--port", "0", "--data", str(data)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        assert process.stdout is not None
        try:
            said = process.stdout.readline() + process.stdout.readline()
            address, token = re.search(r"https?://\S+", said), re.search(r"dohyo_\S+", said)
            if address is None or token is None:
                raise SystemExit(f"the service did not start: {said!r}")
            headers = {"authorization": f"Bearer {token[0]}"}
            with httpx.Client(base_url=address[0], headers=headers, timeout=START_S) as client:
                wait_until(lambda: client.get("/health/ready").is_success, START_S)
                yield client
        finally:
            process.terminate()


def wait_until(done: Callable[[], bool], limit_s: float) -> None:
    """Asks every half second.

    Raises:
        SystemExit: If it takes longer.
    """
    deadline = time.monotonic() + limit_s
    while True:
        with contextlib.suppress(httpx.TransportError):
            if done():
                return
        if time.monotonic() > deadline:
            raise SystemExit(f"not done within {limit_s:.0f} s")
        time.sleep(0.5)


def evaluate(client: Client, agent: str) -> str:
    """Submits a built-in agent and starts a ranked run of it on quickstart; returns the evaluation's id."""
    client.register_agent(agent, f"the built-in {agent}")
    client.submit_builtin(agent, agent)
    return client.evaluate(agent, "quickstart", ranked=True)["id"]


def episode_of(client: httpx.Client, evaluation: str) -> str:
    """The id of the episode of the picture."""
    episodes = client.get(f"/v1/evaluations/{evaluation}/episodes").raise_for_status().json()["items"]
    return str(next(one["id"] for one in episodes if (one["scenario"], one["seed"]) == (SCENARIO, SEED)))


def first_hit_s(client: httpx.Client, episode: str) -> float:
    """When the episode's first collision is."""
    egos = client.get(f"/v1/episodes/{episode}/events").raise_for_status().json()["egos"]
    return float(
        next(one["time_s"] for ego in egos for one in ego["infractions"] if one["kind"].startswith("collision"))
    )


def take(page: Page, address: str, path: Path) -> None:
    """Opens a page and writes what is seen of it."""
    page.goto(address)
    page.wait_for_selector("main[data-state=ready]")
    page.wait_for_timeout(500)
    page.screenshot(path=path)
    Image.open(path).convert("RGB").save(path, optimize=True)
    print(f"{path} {path.stat().st_size // 1000} kB")


def main() -> None:
    """Writes dashboard.png and replay.png beside this file."""
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    if chromium is None:
        raise SystemExit("expected chromium on this machine")
    with tempfile.TemporaryDirectory() as folder, service(Path(folder)) as client, sync_playwright() as playwright:
        with Client(str(client.base_url), client.headers["authorization"].removeprefix("Bearer ")) as submitter:
            evaluations = [evaluate(submitter, agent) for agent in AGENTS]
            for one in evaluations:
                submitter.wait(one, DRIVE_S)
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox", "--disable-gpu"])
        page = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT})
        origin = str(client.base_url).rstrip("/")
        hit = episode_of(client, evaluations[1])
        take(page, f"{origin}/?benchmark=quickstart", DOCS / "dashboard.png")
        page.set_viewport_size({"width": WIDTH, "height": 1120})
        take(page, f"{origin}/episodes/{hit}#t={first_hit_s(client, hit) + 0.4:.1f}", DOCS / "replay.png")
        browser.close()


if __name__ == "__main__":
    main()
