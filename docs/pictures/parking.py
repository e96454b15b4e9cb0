"""Draws docs/pictures/parking.png: film strips of manoeuvres, one row for each lot, with the ways of the karts.

    python docs/pictures/parking.py [BENCHMARK:SEED[:POLICY] ...] [--agent NAME] [--out FILE]

A seed is that of a lot, such as `parking-three:1073741825`; POLICY is a file that `dohyo train parking` exported, which
drives instead of the agent. agents/parking/README.md has a sheet of policies.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from dohyo.agents.registry import resolve
from dohyo.evaluation.parking.agent import ParkingAgent
from dohyo.evaluation.parking.benchmark import load_parking_benchmark, scene_of
from dohyo.evaluation.parking.running import make_agents
from dohyo.sumo_networks.parking import kart
from dohyo.sumo_networks.parking.observation import columns
from dohyo.sumo_networks.parking.picture import draw_picture
from dohyo.sumo_networks.parking.rows import LotView
from dohyo.sumo_networks.parking.rules import JUDGED
from dohyo.sumo_networks.parking.world import ParkingWorld

LOTS = ("parking-complex:1073741826", "parking-three:1073741832", "parking-pedestrians:1073741827")
FRAMES, SIZE, GAP, TITLE = 5, 300, 8, 22
POLICY = "dohyo.agents.parking.policy_agent:PolicyAgent"
SAND, INK = "#FAF8F4", "#1F2328"


def frames(benchmark: str, seed: int, agent: str, settings: dict[str, str]) -> tuple[list[np.ndarray], list[float]]:
    """Pictures at equal intervals of one drive, and their times, s."""
    found = load_parking_benchmark(benchmark)
    agents, world = make_agents(found, resolve(agent), settings), ParkingWorld(1, found.karts)
    world.draw([0], [seed], scene_of(found.scene), JUDGED)
    for one in agents:
        one.reset(seed)
    views = [copied(world.view(0))]
    while world.running.any():
        world.step(np.array([[decided(one, world, number) for number, one in enumerate(agents)]]))
        views.append(copied(world.view(0)))
    driven = np.array([view.karts[:, [kart.X, kart.Y]] for view in views])
    chosen = np.linspace(0, len(views) - 1, FRAMES).round().astype(int).tolist()
    ways = [driven[:, number] for number in range(found.karts)]
    return [draw_picture(views[tick], SIZE, ways) for tick in chosen], [0.1 * tick for tick in chosen]


def copied(view: LotView) -> LotView:
    """What moves in a lot, as it is now."""
    return replace(view, karts=view.karts.copy(), walkers=view.walkers.copy(), counts=view.counts.copy())


def decided(agent: ParkingAgent, world: ParkingWorld, number: int) -> np.ndarray:
    """Action of one kart's agent; full brake once its episode has ended."""
    if not world.running[0, number]:
        return np.array([0.0, 0.0, 1.0])
    if agent.spec.track == "privileged":
        agent.look(world.view(0), number)
    return np.asarray(agent.act(world.observations[0, number, columns(agent.spec.state)]), np.float64)


def strip(lot: str, agent: str) -> Image.Image:
    """One row: frames side by side, cut to the lot, with their times."""
    benchmark, seed, *policy = lot.split(":")
    settings = {"policy": policy[0]} if policy else {}
    pictures, times = frames(benchmark, int(seed), POLICY if policy else agent, settings)
    drawn = np.flatnonzero((np.array(pictures) != pictures[0][0, 0]).any(axis=(0, 2, 3)))
    shown = slice(max(drawn[0] - GAP, 0), drawn[-1] + GAP)
    row = Image.new("RGB", (FRAMES * (SIZE + GAP) + GAP, TITLE + shown.stop - shown.start), SAND)
    pen, font = ImageDraw.Draw(row), ImageFont.load_default(size=14)
    for column, (picture, time_s) in enumerate(zip(pictures, times, strict=True)):
        left, title = GAP + column * (SIZE + GAP), f"{time_s:.0f} s"
        pen.text((left + GAP, GAP // 2), f"{benchmark}, {title}" if column == 0 else title, fill=INK, font=font)
        row.paste(Image.fromarray(picture[shown]), (left, TITLE))
    return row


def main() -> None:
    """Draws all rows."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("lots", nargs="*", default=LOTS)
    parser.add_argument("--agent", default="dohyo.agents.parking.expert.agent:ExpertAgent")
    parser.add_argument("--out", type=Path, default=Path(__file__).with_name("parking.png"))
    given = parser.parse_args()
    rows = [strip(lot, given.agent) for lot in given.lots]
    sheet = Image.new("RGB", (rows[0].width, sum(row.height for row in rows)), SAND)
    for number, row in enumerate(rows):
        sheet.paste(row, (0, sum(above.height for above in rows[:number])))
    sheet.quantize(64).save(given.out, optimize=True)
    print(given.out)


if __name__ == "__main__":
    main()
