"""Draws the README's picture: the same moment of the same scenario, with two agents. `make picture` runs it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dohyo.agents.registry import agent_entries
from dohyo.evaluation.agent import make_agent
from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.evaluation.criteria import criteria_for
from dohyo.evaluation.records.record import Infraction
from dohyo.sumo_networks.envs.driving_env import DrivingEnv
from dohyo.sumo_networks.scenario import Scenario
from dohyo.sumo_networks.world import ActorKind, LightState, World

MISSION, SEED, MOMENT_S = "right-to-south", 0, 14.1
CENTRE_M, SIZE_M = (5764.0, 5656.0), (104.0, 78.0)
SCALE, GAP, HEADER = 4.5, 24, 56
TRAIL_TICKS = 20

SAND, INK, QUIET, LINE, ACCENT = "#FAF8F4", "#1F2328", "#6B7280", "#E5E0D8", "#5B4B8A"
LANE, CROSSING, ACTOR, PERSON, INFRACTION = "#D9D4CA", "#FFFFFF", "#6B7280", "#1F2328", "#B3362E"
LIGHTS = {LightState.RED: "#B3362E", LightState.YELLOW: "#B7791F", LightState.GREEN: "#2E7D5B"}
WORDS = {"red_light": "red light", "collision_pedestrian": "pedestrian", "collision_vehicle": "vehicle"}


@dataclass(frozen=True)
class Drive:
    """One agent's drive up to the moment of the picture."""

    agent: str
    worlds: list[World]
    infractions: list[Infraction]


def drive(agent: str, scenario: Scenario) -> Drive:
    """Drives the scenario's only ego up to the moment, judged by all criteria."""
    driver = make_agent(agent_entries()[agent])
    env = DrivingEnv(scenario, driver.spec.sensors, driver.spec.control, reward=None)
    observations, _ = env.reset()
    driver.reset(scenario.missions[0], scenario.seed)
    criteria = criteria_for(scenario)
    for criterion in criteria:
        criterion.start(env.world, 0)
    worlds, infractions = [env.world], []
    while env.agents and env.world.time < MOMENT_S - 0.05:
        observations = env.step({"ego": driver.act(observations["ego"])})[0]
        worlds.append(env.world)
        infractions += [found for one in criteria for found in one.update(worlds[-2], worlds[-1], 0)]
    env.close()
    return Drive(agent, worlds, infractions)


def panel(one: Drive) -> str:
    """SVG of one drive, in metres, y up."""
    world = one.worlds[-1]
    return "\n".join([*roads(world), *route(world), *trails(one.worlds), *actors(world), *marks(one.infractions)])


def roads(world: World) -> Iterable[str]:
    """Lanes, crossings, and stop lines in the state of their light."""
    network = world.network
    for lane in np.flatnonzero(network.lanes.drivable):
        if shape := line(network.lane_shape(int(lane))):
            yield f'<path d="{shape}" stroke="{LANE}" stroke-width="{network.lanes.width[lane] - 0.15:.2f}"/>'
    for lane in np.flatnonzero(network.lanes.crossing):
        if shape := line(network.lane_shape(int(lane))):
            yield f'<path d="{shape}" stroke="{CROSSING}" stroke-width="3" stroke-dasharray="0.5 0.5"/>'
    for row, (x0, y0, x1, y1) in enumerate(network.stop_lines.segment):
        signals = network.connections.signal[network.connections_from(int(network.stop_lines.lane[row]))]
        states = {LightState(world.signals[signal]) for signal in signals if signal >= 0}
        colour = LIGHTS.get(max(states, default=LightState.OFF))
        if colour and (shape := line(np.array([[x0, y0], [x1, y1]]))):
            yield f'<path d="{shape}" stroke="{colour}" stroke-width="0.9"/>'


def route(world: World) -> Iterable[str]:
    """The ego's route, as a soft band."""
    yield f'<path d="{line(world.routes[0].position)}" stroke="{ACCENT}" stroke-width="2.2" opacity="0.22"/>'


def trails(worlds: list[World]) -> Iterable[str]:
    """Where everything was in the last two seconds."""
    recent = worlds[-TRAIL_TICKS - 1 :]
    places: dict[int, list[np.ndarray]] = {}
    for world in recent:
        for key, place in zip(world.actors.key, world.actors.position, strict=True):
            places.setdefault(int(key), []).append(place)
    for path in places.values():
        if len(path) > 1 and (shape := line(np.array(path))):
            yield f'<path d="{shape}" stroke="{ACTOR}" stroke-width="0.5" opacity="0.4"/>'
    driven = line(np.array([world.egos.position[0] for world in recent]))
    yield f'<path d="{driven}" stroke="{ACCENT}" stroke-width="0.7" opacity="0.6"/>'


def actors(world: World) -> Iterable[str]:
    """Vehicles as boxes with a notch at the front, people as discs, the ego in its own colour."""
    others = world.actors
    for kind, (x, y, heading, length, width) in zip(others.kind, others.boxes(), strict=True):
        if not inside(x, y):
            continue
        if kind == ActorKind.PEDESTRIAN:
            yield f'<circle cx="{x:.1f}" cy="{y:.1f}" r="0.6" fill="{PERSON}"/>'
        else:
            yield box(x, y, heading, length, width, ACTOR)
    yield box(*world.egos.box(0), ACCENT)


def box(x: float, y: float, heading: float, length: float, width: float, colour: str) -> str:
    """A vehicle, true to size."""
    a, b, nose = length / 2, width / 2, length / 2 - min(1.0, length / 4)
    points = f"{-a:.2f},{-b:.2f} {nose:.2f},{-b:.2f} {a:.2f},0 {nose:.2f},{b:.2f} {-a:.2f},{b:.2f}"
    place = f"translate({x:.2f} {y:.2f}) rotate({math.degrees(heading):.1f})"
    return f'<polygon points="{points}" transform="{place}" fill="{colour}" stroke="{SAND}" stroke-width="0.15"/>'


def marks(infractions: Iterable[Infraction]) -> Iterable[str]:
    """Rings where something went wrong, numbered as in the header."""
    for number, one in enumerate(infractions, start=1):
        yield f'<circle cx="{one.x_m:.1f}" cy="{one.y_m:.1f}" r="3" stroke="{INFRACTION}" stroke-width="0.5"/>'
        aside = -4.5 if number % 2 else 2.5
        yield (
            f'<text transform="translate({one.x_m + aside:.1f} {one.y_m + 3.0:.1f}) scale(1 -1)" font-size="3.6" '
            f'font-weight="700" fill="{INFRACTION}">{number}</text>'
        )


def line(points: np.ndarray) -> str:
    """SVG path of the points, empty where none of them is in the picture; a margin keeps long segments whole."""
    if not any(inside(x, y, margin=60.0) for x, y in points):
        return ""
    return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points)


def inside(x: float, y: float, margin: float = 2.0) -> bool:
    """Whether a point is in the picture."""
    return abs(x - CENTRE_M[0]) < SIZE_M[0] / 2 + margin and abs(y - CENTRE_M[1]) < SIZE_M[1] / 2 + margin


def caption(one: Drive) -> str:
    """What happened so far."""
    speed = one.worlds[-1].egos.speed[0]
    events = "; ".join(
        f"{number} {WORDS.get(event.kind, event.kind.replace('_', ' '))} {event.time_s:.1f} s"
        for number, event in enumerate(one.infractions, start=1)
    )
    return f"{speed:.1f} m/s; {events or 'no infraction'}"


def picture(drives: Iterable[Drive]) -> str:
    """The whole SVG: the drives side by side."""
    width, height = SIZE_M[0] * SCALE, SIZE_M[1] * SCALE
    left, bottom = CENTRE_M[0] - SIZE_M[0] / 2, CENTRE_M[1] - SIZE_M[1] / 2
    parts = []
    for column, one in enumerate(drives):
        x = GAP + column * (width + GAP)
        frame = f'width="{width:.0f}" height="{height:.0f}"'
        view = f'viewBox="{left:.1f} {-bottom - SIZE_M[1]:.1f} {SIZE_M[0]} {SIZE_M[1]}"'
        parts += [
            f'<text x="{x:.0f}" y="24" font-size="16" font-weight="700" fill="{INK}">{one.agent}</text>',
            f'<text x="{x:.0f}" y="44" font-size="13" fill="{QUIET}">{caption(one)}</text>',
            f'<svg x="{x:.0f}" y="{HEADER}" {frame} {view} stroke-linejoin="round" fill="none">',
            '<g transform="scale(1 -1)">',
            panel(one),
            "</g></svg>",
            f'<rect x="{x:.0f}" y="{HEADER}" {frame} fill="none" stroke="{LINE}" rx="6"/>',
        ]
    total = 3 * GAP + 2 * width
    note = (
        f"quickstart, {MISSION}, seed {SEED}, after {MOMENT_S:.1f} s. Accent: the ego and its route. Boxes: vehicles. "
        "Discs: pedestrians. Stop lines show their light."
    )
    parts.append(f'<text x="{GAP}" y="{HEADER + height + 22:.0f}" font-size="12" fill="{QUIET}">{note}</text>')
    size = f'width="{total:.0f}" height="{HEADER + height + 36:.0f}"'
    head = f'<svg xmlns="http://www.w3.org/2000/svg" {size} font-family="ui-sans-serif, system-ui, sans-serif">'
    return "\n".join([head, f'<rect width="100%" height="100%" fill="{SAND}"/>', *parts, "</svg>", ""])


def main() -> None:
    """Writes picture.svg beside this file."""
    scenario = next(one for one in load_benchmark("quickstart").scenarios([SEED]) if one.name == MISSION)
    path = Path(__file__).with_suffix(".svg")
    path.write_text(picture([drive("autopilot", scenario), drive("reckless", scenario)]))
    print(f"picture: {path}")


if __name__ == "__main__":
    main()
