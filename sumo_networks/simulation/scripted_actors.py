"""Scripted actors as rows of the world's table. SUMO does not move them, so they are not read from SUMO."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from dohyo.sumo_networks.actors.external import ExternalActor
from dohyo.sumo_networks.actors.scripted_actor import ScriptedActor
from dohyo.sumo_networks.arrays import BoolArray
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.simulation.registry import ActorRegistry
from dohyo.sumo_networks.units import SIGHT_M
from dohyo.sumo_networks.world import Actors, Egos


def with_scripted(
    actors: Actors, scripted: Sequence[ScriptedActor], egos: Egos, registry: ActorRegistry, network: RoadNetwork
) -> Actors:
    """Table of the actors and of the scripted actors within sight of an ego, in the order of keys."""
    viewpoints = egos.position[egos.active].tolist()
    seen = [one for one in scripted if any(one.distance(x, y) <= SIGHT_M for x, y in viewpoints)]
    if not seen:
        return actors
    anywhere = np.zeros(len(network.lanes.ids), dtype=np.bool_)
    rows = Actors(
        key=np.array([_key(one, registry) for one in seen], dtype=np.int64),
        kind=np.array([int(one.kind) for one in seen], dtype=np.int64),
        position=np.array([(one.x, one.y) for one in seen], dtype=np.float64),
        heading=np.array([math.remainder(one.heading, 2 * math.pi) for one in seen], dtype=np.float64),
        speed=np.array([math.hypot(one.speed, one.drift) for one in seen], dtype=np.float64),
        length=np.array([one.length for one in seen], dtype=np.float64),
        width=np.array([one.width for one in seen], dtype=np.float64),
        lane=np.array([lane_under(one, network, anywhere) for one in seen], dtype=np.int64),
        indicator=np.array([one.indicator or int(np.sign(one.drift)) for one in seen], dtype=np.int64),
    )
    table = Actors.concat([actors, rows])
    return table.take(np.argsort(table.key, kind="stable"))


def lane_under(actor: ScriptedActor | ExternalActor, network: RoadNetwork, anywhere: BoolArray) -> int:
    """Lane under an actor, -1 if none.

    Args:
        actor: The actor.
        network: The road network.
        anywhere: (L,) False for every lane: no lane is preferred.
    """
    lane, offset, _ = network.nearest_lane(actor.x, actor.y, actor.heading, anywhere)
    return lane if lane >= 0 and abs(offset) <= 0.5 * network.lanes.width.item(lane) else -1


def _key(actor: ScriptedActor, registry: ActorRegistry) -> int:
    key = registry.keys.get(actor.name)
    return registry.register(actor.name, actor.kind, actor.length, actor.width) if key is None else key
