"""Draws docs/pictures/senses.png: what cameras and bird's-eye view show, in each of the conditions.

    python docs/pictures/senses.py [--large DIR]

With --large, it also writes each network in all conditions and modes, 512 px wide, one file per network.
"""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from dohyo.agents.registry import agent_entries
from dohyo.evaluation.agent import make_agent
from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.sumo_networks.conditions import CONDITIONS
from dohyo.sumo_networks.envs.driving_env import DrivingEnv
from dohyo.sumo_networks.rendering.labels import Label
from dohyo.sumo_networks.scenario import Mission, Place, Scenario, Traffic
from dohyo.sumo_networks.sensors import BirdseyeConfig, CameraConfig, SensorConfig, make_sensors
from dohyo.sumo_networks.world import LightState, World

SEED = 4
WIDTH, HEIGHT = 384, 288
GAP, TITLE = 12, 26
SAND, INK, QUIET = "#FAF8F4", "#1F2328", "#6B7280"
LABELS: dict[Label, tuple[int, int, int]] = {
    Label.NONE: (250, 248, 244),
    Label.TERRAIN: (196, 206, 170),
    Label.ROAD: (92, 96, 104),
    Label.MARKING: (236, 236, 228),
    Label.CROSSING: (190, 190, 198),
    Label.SIDEWALK: (212, 200, 180),
    Label.CYCLEWAY: (196, 120, 104),
    Label.BUILDING: (168, 152, 196),
    Label.POLE: (110, 110, 120),
    Label.STOP_SIGN: (176, 24, 90),
    Label.VEHICLE: (0, 114, 178),
    Label.EMERGENCY: (204, 121, 167),
    Label.BICYCLE: (86, 180, 233),
    Label.PEDESTRIAN: (230, 159, 0),
    Label.OBSTACLE: (213, 94, 0),
    Label.LIGHT_OFF: (60, 60, 60),
    Label.LIGHT_RED: (220, 40, 36),
    Label.LIGHT_YELLOW: (240, 200, 40),
    Label.LIGHT_GREEN: (0, 158, 115),
}


def scenarios() -> dict[str, Scenario]:
    """One drive per network."""
    town = next(one for one in load_benchmark("nocrash").scenarios([0]) if one.network == "town-train")
    adlershof = Mission(
        start=Place(lane="46039050#0_2", position_m=8.0), goal=Place(lane="414563781_4", position_m=-15.0)
    )
    ingolstadt = Mission(
        start=Place(lane="737320747#3_2", position_m=8.0), goal=Place(lane="726514449_2", position_m=-15.0)
    )
    return {
        "ingolstadt": Scenario(network="ingolstadt", missions=(ingolstadt,), traffic=crowd(90), seed=SEED),
        "town-train": Scenario(network="town-train", missions=town.missions, traffic=crowd(120), seed=SEED),
        "adlershof": Scenario(network="adlershof", missions=(adlershof,), traffic=crowd(2000), seed=SEED),
    }


def crowd(vehicles: int) -> Traffic:
    """Dense traffic."""
    return Traffic(vehicles=vehicles, bicycles=vehicles // 6, pedestrians=vehicles, warm_up_s=60.0)


def moment(scenario: Scenario, seconds: float = 60.0) -> World:
    """The world of a drive in which most can be seen: actors ahead, and a light."""
    agent = make_agent(agent_entries()["autopilot"])
    env = DrivingEnv(scenario, sensors=agent.spec.sensors, control=agent.spec.control, reward=None)
    (name,) = env.possible_agents
    observations, _ = env.reset()
    agent.reset(scenario.missions[0], SEED)
    best, most = env.world, -1.0
    while env.agents and env.world.time < seconds:
        observations, *_ = env.step({name: agent.act(observations[name])})
        value = interest(env.world)
        if value > most:
            best, most = dataclasses.replace(env.world, signals=env.world.signals.copy()), value
    env.close()
    return best


def interest(world: World) -> float:
    """Pixels of people, vehicles and lights in a small picture, none of them filling it."""
    (camera,) = make_sensors([CameraConfig(name="scout", mode="semantic", width=96, height=72)])
    labels, counts = np.unique(camera.read(world, 0), return_counts=True)
    found = dict(zip(labels.tolist(), counts.tolist(), strict=True))
    lights = sum(found.get(Label.LIGHT_OFF + state, 0) for state in LightState if state is not LightState.OFF)
    several = (Label.VEHICLE, Label.PEDESTRIAN, Label.BICYCLE, Label.EMERGENCY)
    return sum(min(found.get(label, 0), 150) for label in several) ** 0.5 + 3.0 * min(lights, 60) ** 0.5


def picture(config: SensorConfig, world: World, conditions: str = "clear") -> Image.Image:
    """What one sensor shows, as colours."""
    (sensor,) = make_sensors([config], conditions=CONDITIONS[conditions], rng=np.random.default_rng(SEED))
    array = sensor.read(world, 0)
    if array.shape[0] == 3:
        colours = np.moveaxis(array, 0, -1)
    elif array.dtype == np.uint8:
        colours = np.array([LABELS[label] for label in Label], dtype=np.uint8)[array[0]]
    else:
        near = np.clip(1.0 - np.log(np.maximum(array[0], 2.0) / 2.0) / np.log(50.0), 0.0, 1.0)[..., None]
        shade = np.array([236, 231, 222]) * (1 - near) + np.array([58, 38, 110]) * near
        colours = np.where(array[0][..., None] >= 1000.0, 250, shade).astype(np.uint8)
    return Image.fromarray(np.ascontiguousarray(colours))


def sheet(rows: list[list[tuple[str, Image.Image]]]) -> Image.Image:
    """Titled pictures in rows."""
    width = max(sum(one.width + GAP for _, one in row) for row in rows) + GAP
    height = sum(max(one.height for _, one in row) + TITLE + GAP for row in rows) + GAP
    paper = Image.new("RGB", (width, height), SAND)
    draw, font, top = ImageDraw.Draw(paper), ImageFont.load_default(15), GAP
    for row in rows:
        left = GAP
        for title, one in row:
            draw.text((left, top), title, fill=INK, font=font)
            paper.paste(one, (left, top + TITLE - 2))
            left += one.width + GAP
        top += max(one.height for _, one in row) + TITLE + GAP
    return paper


def contact_sheet(worlds: dict[str, World]) -> Image.Image:
    """The picture of the documents."""
    size = {"width": WIDTH, "height": HEIGHT}
    camera = CameraConfig(name="camera", **size)
    names = list(CONDITIONS)
    conditions = [(f"camera, {name}", picture(camera, worlds["ingolstadt"], name)) for name in names]
    town, city = worlds["town-train"], worlds["adlershof"]
    modes = [
        (f"{mode}, adlershof", picture(CameraConfig(name="camera", mode=mode, **size), city))  # type: ignore[arg-type]
        for mode in ("rgb", "semantic", "depth")
    ]
    wide = {"width": WIDTH, "height": 216, "fov_deg": 70.0}
    rig = [
        (f"camera_{side}, town-train", picture(CameraConfig(name=side, yaw_deg=yaw, **wide), town))  # type: ignore[arg-type]
        for side, yaw in (("left", 60.0), ("front", 0.0), ("right", -60.0))
    ]
    above = {"mode": "rgb", "width": WIDTH, "height": WIDTH, "metres_per_px": 0.125}
    views = [
        (f"birdseye_rgb, {name}", picture(BirdseyeConfig(name="view", **above), world))  # type: ignore[arg-type]
        for name, world in worlds.items()
    ]
    return sheet([conditions[:3], conditions[3:], modes, rig, views])


def large_sheet(world: World) -> Image.Image:
    """One network in all conditions and modes."""
    size = {"width": 512, "height": 384}
    rows = []
    for mode in ("rgb", "semantic", "depth"):
        config = CameraConfig(name="camera", mode=mode, **size)  # type: ignore[arg-type]
        pictures = [(f"{mode}, {name}", picture(config, world, name)) for name in CONDITIONS]
        rows += [pictures[:3], pictures[3:]]
    return sheet(rows)


def main() -> None:
    """Writes senses.png beside this file."""
    worlds = {name: moment(scenario) for name, scenario in scenarios().items()}
    path = Path(__file__).with_suffix(".png")
    contact_sheet(worlds).save(path, optimize=True)
    print(f"picture: {path}")
    if "--large" in sys.argv:
        folder = Path(sys.argv[sys.argv.index("--large") + 1])
        for name, world in worlds.items():
            large_sheet(world).save(folder / f"senses-{name}.png")
            print(f"picture: {folder / f'senses-{name}.png'}")


if __name__ == "__main__":
    main()
