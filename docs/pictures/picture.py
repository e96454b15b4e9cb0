"""Draws the README's moving picture: seconds of the same scenario, with two agents. `make picture` runs it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from motion import Motion

from dohyo.agents.registry import agent_entries
from dohyo.evaluation.agent import make_agent
from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.evaluation.episode.judge import Judge
from dohyo.evaluation.records.record import Infraction
from dohyo.sumo_networks.envs.driving_env import DrivingEnv
from dohyo.sumo_networks.scenario import Scenario
from dohyo.sumo_networks.world import ActorKind, LightState, World

MISSION, SEED = "right-to-south", 0
FIRST_S, LAST_S, HOLD_S = 10.5, 17.0, 1.5
CENTRE_M, SIZE_M = np.array([5764.0, 5656.0]), (104.0, 78.0)
SCALE, GAP, HEADER = 4.5, 24, 56

SAND, INK, QUIET, LINE, ACCENT = "#FAF8F4", "#1F2328", "#6B7280", "#E5E0D8", "#5B4B8A"
LANE, CROSSING, ACTOR, PERSON, INFRACTION = "#D9D4CA", "#FFFFFF", "#6B7280", "#1F2328", "#B3362E"
LIGHTS = {LightState.RED: "#B3362E", LightState.YELLOW: "#B7791F", LightState.GREEN: "#2E7D5B"}
NO_LIGHT = "none"
WORDS = {"red_light": "red light", "collision_pedestrian": "pedestrian hit", "collision_vehicle": "vehicle hit"}
HIDDEN, SHOWN = "opacity:0", "opacity:1"


@dataclass(frozen=True)
class Drive:
    """What one agent did in the seconds of the picture."""

    agent: str
    worlds: list[World]
    infractions: list[Infraction]

    @property
    def time_s(self) -> np.ndarray:
        """(T,) since the beginning of the picture."""
        return np.array([world.time for world in self.worlds]) - FIRST_S


def drive(agent: str, scenario: Scenario) -> Drive:
    """Drives the scenario's only ego up to the last moment, judged by all criteria."""
    driver = make_agent(agent_entries()[agent])
    env = DrivingEnv(scenario, driver.spec.sensors, driver.spec.control, reward=None)
    observations, _ = env.reset()
    driver.reset(scenario.missions[0], scenario.seed)
    judge, worlds = Judge(scenario, 0), [env.world]
    judge.start(env.world)
    while env.agents and env.world.time < LAST_S - 0.05:
        observations = env.step({"ego": driver.act(observations["ego"])})[0]
        worlds.append(env.world)
        judge.update(worlds[-2], worlds[-1])
    env.close()
    return Drive(agent, [world for world in worlds if world.time > FIRST_S - 0.05], judge.infractions)


def ground(world: World) -> Iterator[str]:
    """Lanes, crossings and the ego's route: what does not move, and both panels share."""
    network = world.network
    for lane in np.flatnonzero(network.lanes.drivable):
        if shape := line(network.lane_shape(int(lane))):
            yield f'<path d="{shape}" stroke="{LANE}" stroke-width="{network.lanes.width[lane] - 0.15:.2f}"/>'
    for lane in np.flatnonzero(network.lanes.crossing):
        if shape := line(network.lane_shape(int(lane))):
            yield f'<path d="{shape}" stroke="{CROSSING}" stroke-width="3" stroke-dasharray="0.5 0.5"/>'
    yield f'<path d="{line(world.routes[0].position)}" stroke="{ACCENT}" stroke-width="2.2" opacity="0.22"/>'


def stop_lines(one: Drive, motion: Motion) -> Iterator[str]:
    """Stop lines, in the state of their light."""
    network = one.worlds[0].network
    for row, (x0, y0, x1, y1) in enumerate(network.stop_lines.segment):
        signals = network.connections.signal[network.connections_from(int(network.stop_lines.lane[row]))]
        lamps = signals[signals >= 0]
        if not len(lamps) or not (shape := line(np.array([[x0, y0], [x1, y1]]))):
            continue
        colours = [LIGHTS.get(max(map(LightState, world.signals[lamps])), NO_LIGHT) for world in one.worlds]
        moves = changed(one.time_s, [f"stroke:{colour}" for colour in colours])
        animated = f' class="{motion.states(moves)}"' if len(moves) > 1 else ""
        yield f'<path d="{shape}" stroke="{colours[-1]}" stroke-width="0.9"{animated}/>'


def actors(one: Drive, motion: Motion) -> Iterator[str]:
    """Vehicles as boxes with a notch at the front, people as discs, the ego in its own colour."""
    seen: dict[int, list[tuple[float, np.ndarray, int]]] = {}
    for time_s, world in zip(one.time_s, one.worlds, strict=True):
        others = world.actors
        for key, kind, box in zip(others.key, others.kind, others.boxes(), strict=True):
            seen.setdefault(int(key), []).append((float(time_s), box, int(kind)))
    for states in seen.values():
        times, boxes = np.array([state[0] for state in states]), np.array([state[1] for state in states])
        if any(inside(x, y) for x, y in boxes[:, :2]):
            disc = states[0][2] == ActorKind.PEDESTRIAN
            shape = f'<circle r="0.6" fill="{PERSON}"' if disc else vehicle(*boxes[0, 3:], ACTOR)
            poses = boxes[:, :3] * [1.0, 1.0, 0.0 if disc else 1.0]
            yield moving(shape, times, poses, motion, leaves=times[-1] < one.time_s[-1] - 0.05)
    ego = np.array([world.egos.box(0) for world in one.worlds])
    yield moving(vehicle(*ego[0, 3:], ACCENT), one.time_s, ego[:, :3], motion, leaves=False)


def moving(shape: str, time_s: np.ndarray, poses: np.ndarray, motion: Motion, leaves: bool) -> str:
    """An element that moves, and is not there before its first pose or, if it leaves, after its last."""
    poses = poses - [*CENTRE_M, 0.0]
    x, y, heading = poses[-1]
    place = f"translate({x:.1f} {y:.1f}) rotate({np.degrees(heading):.0f})"
    element = f'{shape} transform="{place}" class="{motion.poses(time_s, poses)}"/>'
    presence = [(float(time_s[0]), SHOWN)]
    if time_s[0] > 0.05:
        presence.insert(0, (0.0, HIDDEN))
    if leaves:
        presence.append((float(time_s[-1]), HIDDEN))
    if len(presence) == 1:
        return element
    still = ' opacity="0"' if leaves else ""
    return f'<g class="{motion.states(presence)}"{still}>{element}</g>'


def vehicle(length: float, width: float, colour: str) -> str:
    """The beginning of a vehicle's element, true to size, its centre at the origin."""
    a, b, nose = length / 2, width / 2, length / 2 - min(1.0, length / 4)
    points = f"{-a:.2f},{-b:.2f} {nose:.2f},{-b:.2f} {a:.2f},0 {nose:.2f},{b:.2f} {-a:.2f},{b:.2f}"
    return f'<polygon points="{points}" fill="{colour}" stroke="{SAND}" stroke-width="0.15"'


def marks(infractions: Iterable[Infraction], motion: Motion) -> Iterator[str]:
    """Rings where something went wrong, from then on, numbered as in the header."""
    for number, one in enumerate(infractions, start=1):
        x, y = one.x_m - CENTRE_M[0], one.y_m - CENTRE_M[1]
        yield f'<g class="{motion.states(since(one))}">'
        yield f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3" stroke="{INFRACTION}" stroke-width="0.5"/>'
        aside = -4.5 if number % 2 else 2.5
        yield (
            f'<text transform="translate({x + aside:.1f} {y + 3.0:.1f}) scale(1 -1)" font-size="3.6" '
            f'font-weight="700" fill="{INFRACTION}">{number}</text></g>'
        )


def caption(one: Drive, x: float, motion: Motion) -> Iterator[str]:
    """The agent's name, and what went wrong so far."""
    yield f'<text x="{x:.0f}" y="24" font-size="16" font-weight="700" fill="{INK}">{one.agent}</text>'
    colour = INFRACTION if one.infractions else QUIET
    words = "".join(told(number, event, motion) for number, event in enumerate(one.infractions, start=1))
    yield f'<text x="{x:.0f}" y="44" font-size="13" fill="{colour}">{words or "no infraction"}</text>'


def told(number: int, event: Infraction, motion: Motion) -> str:
    """One infraction in the header, from when it happens on."""
    words = WORDS.get(event.kind, event.kind.replace("_", " "))
    between = "; " if number > 1 else ""
    return f'<tspan class="{motion.states(since(event))}">{between}{number} {words} {event.time_s:.1f} s</tspan>'


def since(event: Infraction) -> list[tuple[float, str]]:
    """Hidden until it happens."""
    return [(0.0, HIDDEN), (event.time_s - FIRST_S, SHOWN)]


def changed(time_s: np.ndarray, states: list[str]) -> list[tuple[float, str]]:
    """The first state, and each that differs from the one before."""
    rows = [row for row, state in enumerate(states) if row == 0 or state != states[row - 1]]
    return [(float(time_s[row]), states[row]) for row in rows]


def line(points: np.ndarray) -> str:
    """SVG path of the points, empty where none of them is in the picture; a margin keeps long segments whole."""
    if not any(inside(x, y, margin=60.0) for x, y in points):
        return ""
    return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points - CENTRE_M)


def inside(x: float, y: float, margin: float = 2.0) -> bool:
    """Whether a point is in the picture."""
    return abs(x - CENTRE_M[0]) < SIZE_M[0] / 2 + margin and abs(y - CENTRE_M[1]) < SIZE_M[1] / 2 + margin


def panel(one: Drive, x: float, motion: Motion) -> Iterator[str]:
    """One drive below its name."""
    width, height = SIZE_M[0] * SCALE, SIZE_M[1] * SCALE
    frame = f'x="{x:.0f}" y="{HEADER}" width="{width:.0f}" height="{height:.0f}"'
    view = f'viewBox="{-SIZE_M[0] / 2} {-SIZE_M[1] / 2} {SIZE_M[0]} {SIZE_M[1]}"'
    yield from caption(one, x, motion)
    yield f'<svg {frame} {view} stroke-linejoin="round" fill="none"><g transform="scale(1 -1)">'
    yield '<use href="#ground"/>'
    yield from stop_lines(one, motion)
    yield from actors(one, motion)
    yield from marks(one.infractions, motion)
    yield "</g></svg>"
    yield f'<rect {frame} fill="none" stroke="{LINE}" rx="6"/>'


def picture(drives: list[Drive]) -> str:
    """The whole SVG: the drives side by side."""
    motion = Motion(LAST_S - FIRST_S, HOLD_S)
    width, height = SIZE_M[0] * SCALE, SIZE_M[1] * SCALE
    body = [part for column, one in enumerate(drives) for part in panel(one, GAP + column * (width + GAP), motion)]
    total, below = 3 * GAP + 2 * width, HEADER + height
    note = (
        f"quickstart, {MISSION}, seed {SEED}, from {FIRST_S:g} s to {LAST_S:g} s. Purple: the ego and its route. "
        "Boxes: vehicles. Discs: pedestrians. Stop lines show their light."
    )
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {total:.0f} {below + 36:.0f}" width="{total:.0f}" '
        f'height="{below + 36:.0f}" font-family="ui-sans-serif, system-ui, sans-serif">'
    )
    defined = f'<defs><g id="ground">{"".join(ground(drives[0].worlds[0]))}</g></defs>'
    foot = f'<text x="{GAP}" y="{below + 22:.0f}" font-size="12" fill="{QUIET}">{note}</text>'
    paper = f'<rect width="100%" height="100%" fill="{SAND}"/>'
    return "\n".join([head, motion.style(), defined, paper, *body, foot, "</svg>", ""])


def main() -> None:
    """Writes picture.svg beside this file."""
    scenario = next(one for one in load_benchmark("quickstart").scenarios([SEED]) if one.name == MISSION)
    path = Path(__file__).with_suffix(".svg")
    path.write_text(picture([drive("autopilot", scenario), drive("reckless", scenario)]))
    print(f"picture: {path} {path.stat().st_size // 1000} kB")


if __name__ == "__main__":
    main()
