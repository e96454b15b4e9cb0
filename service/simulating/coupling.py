"""What the simulators that are coupled to a world see of it in each tick."""

from __future__ import annotations

from typing import Literal, cast

import numpy as np

from dohyo.service.simulating.actors import KindName, ShownActor
from dohyo.sumo_networks.actors.names import ego_proxy
from dohyo.sumo_networks.envs.driving_env import DrivingEnv
from dohyo.sumo_networks.world import ActorKind


def shown_actors(env: DrivingEnv) -> list[ShownActor]:
    """All egos and the whole traffic of a world, for the simulators that are coupled to it."""
    world = env.world
    egos = [ego_proxy(name) for name in np.array(world.egos.names)[world.egos.active].tolist()]
    boxes = np.column_stack([world.egos.boxes(), world.egos.speed])[world.egos.active].tolist()
    found = [_shown("ego", name, "car", row) for name, row in zip(egos, boxes, strict=True)]
    names, actors = env.all_actors()
    kinds = [ActorKind(kind).name.lower() for kind in actors.kind.tolist()]
    rows = np.column_stack([actors.boxes(), actors.speed]).tolist()
    return found + [_shown("traffic", *one) for one in zip(names, kinds, rows, strict=True)]


def _shown(role: Literal["ego", "traffic"], name: str, kind: str, row: list[float]) -> ShownActor:
    x, y, heading, length, width, speed = row
    return ShownActor(name, cast(KindName, kind), x, y, heading, speed, length, width, role=role)
