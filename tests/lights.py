"""A junction whose light shows given letters of SUMO's, and worlds in which signals ask for a stop or for yielding.

From west and east a main road, from the south a side road; the mission turns right out of that one, where the light
shows the given letters.
"""

from __future__ import annotations

import dataclasses
import hashlib
import os
import tempfile
from functools import cache

import numpy as np

from dohyo.sumo_networks.networks.network import cache_folder
from dohyo.sumo_networks.rules.right_of_way import RightOfWay
from dohyo.sumo_networks.scenario import Mission, Place
from dohyo.sumo_networks.world import World
from tests.worlds import Scene, _build

ARMS = {"w": (-200, 0, 2), "e": (200, 0, 2), "s": (0, -200, 1)}
SIDE_ROAD_X = 1.6
"""x of the lane that leads northwards to the junction, m."""


@cache
def side_road(*phases: tuple[str, int], left: str = "G", main_road: str = "G") -> Scene:
    """The junction with a light of these phases.

    Args:
        phases: Letter for who turns right out of the side road, and its duration, s.
        left: Letter for who turns left out of it.
        main_road: Letter for the main road.
    """
    nodes = '<node id="c" x="0" y="0" type="traffic_light"/>'
    nodes += "".join(f'<node id="{arm}" x="{x}" y="{y}"/>' for arm, (x, y, _) in ARMS.items())
    ways = [(start, end, rank) for arm, (_, _, rank) in ARMS.items() for start, end in ((arm, "c"), ("c", arm))]
    edges = "".join(
        f'<edge id="{start}_{end}" from="{start}" to="{end}" priority="{rank}" numLanes="1" speed="13.89"/>'
        for start, end, rank in ways
    )
    # The links in SUMO's order: from the east 0 and 1, from the south 2 (right) and 3 (left), from the west 4 and 5.
    shown = "".join(
        f'<phase duration="{seconds}" state="{main_road * 2}{letter}{left}{main_road * 2}"/>'
        for letter, seconds in phases
    )
    program = f'<tlLogics><tlLogic id="c" type="static" programID="0" offset="0">{shown}</tlLogic></tlLogics>'
    file = cache_folder() / "hand-made" / f"{hashlib.sha256(program.encode()).hexdigest()[:16]}.tll.xml"
    if not file.exists():
        file.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile("w", dir=file.parent, delete=False) as draft:
            draft.write(program)
        os.replace(draft.name, file)
    network = _build("side_road", nodes, edges, "--tllogic-files", str(file))
    return Scene(network, Mission(start=Place(lane="s_c_0", position_m=150.0), goal=Place(lane="c_e_0")))


def line_y(scene: Scene) -> float:
    """y of the side road's stop line, m."""
    row = int(np.flatnonzero(scene.network.stop_lines.lane == scene.network.lane_index["s_c_0"])[0])
    return float(scene.network.stop_lines.segment[row, 1])


def asking(world: World, **duties: RightOfWay) -> World:
    """The same world, in which some signals ask for a stop or for yielding.

    Args:
        world: The world.
        duties: By source lane and SUMO's direction letter, such as `s_c_0_r`.
    """
    connections, lanes = world.network.connections, world.network.lanes
    asked = np.zeros(len(world.signals), dtype=np.int64)
    for way, duty in duties.items():
        lane, _, direction = way.rpartition("_")
        chosen = (lanes.ids[connections.source] == lane) & (connections.direction == direction)
        asked[connections.signal[chosen]] = duty
    return dataclasses.replace(world, duties=asked)
