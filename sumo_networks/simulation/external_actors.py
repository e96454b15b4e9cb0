"""External actors as rows of the world's table. SUMO does not move them, so they are not read from SUMO."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from dohyo.sumo_networks.actors.external import ExternalActor
from dohyo.sumo_networks.actors.names import external_actor
from dohyo.sumo_networks.arrays import BoolArray, FloatArray
from dohyo.sumo_networks.geometry import wrap_angle
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.simulation.registry import ActorRegistry
from dohyo.sumo_networks.simulation.scripted_actors import lane_under
from dohyo.sumo_networks.units import SIGHT_M
from dohyo.sumo_networks.world import Actors, Egos


def with_external(
    actors: Actors, external: Iterable[ExternalActor], egos: Egos, registry: ActorRegistry, network: RoadNetwork
) -> Actors:
    """Table of the actors and of the external actors within sight of an ego, in the order of keys."""
    given = list(external)
    place = np.array([(one.x, one.y) for one in given], dtype=np.float64).reshape(-1, 2)
    seen = [given[row] for row in np.flatnonzero(_near(place, egos.position[egos.active]))]
    if not seen:
        return actors
    columns = np.array([(one.x, one.y, one.heading, one.speed, one.length, one.width) for one in seen])
    anywhere = np.zeros(len(network.lanes.ids), dtype=np.bool_)
    rows = Actors(
        key=np.array([_key(one, registry) for one in seen], dtype=np.int64),
        kind=np.array([int(one.kind) for one in seen], dtype=np.int64),
        position=columns[:, :2],
        heading=wrap_angle(columns[:, 2]),
        speed=columns[:, 3],
        length=columns[:, 4],
        width=columns[:, 5],
        lane=np.array([lane_under(one, network, anywhere) for one in seen], dtype=np.int64),
        indicator=np.zeros(len(seen), dtype=np.int64),
    )
    table = Actors.concat([actors, rows])
    return table.take(np.argsort(table.key, kind="stable"))


def _near(place: FloatArray, viewpoints: FloatArray) -> BoolArray:
    """(N,) whether a place is within sight of a viewpoint."""
    apart = place[:, None] - viewpoints[None]
    return np.asarray((np.hypot(apart[..., 0], apart[..., 1]) <= SIGHT_M).any(axis=1))


def _key(actor: ExternalActor, registry: ActorRegistry) -> int:
    name = external_actor(actor.name)
    key = registry.keys.get(name)
    return registry.register(name, actor.kind, actor.length, actor.width) if key is None else key
