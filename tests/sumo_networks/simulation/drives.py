"""Scenarios in SUMO for the tests, and fingerprints of what happens in them."""

from __future__ import annotations

import dataclasses
import hashlib
import sys
from collections.abc import Sequence

import numpy as np

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.scenario import Mission, Place, Scenario, Traffic
from dohyo.sumo_networks.simulation import Simulation, plan_scenario
from dohyo.sumo_networks.world import World
from tests.worlds import Scene, straight_road

BRAKE = np.array([-8.0, 0.0])


def on(scene: Scene, *missions: Mission, **changes: object) -> Scenario:
    """A scenario on a hand-made network."""
    return Scenario(network=str(scene.network.path), missions=missions or (scene.mission,), **changes)  # type: ignore[arg-type]


def standing_at(x: float, lane: str = "w_e_0", name: str = "ego") -> Mission:
    """A mission on the straight road that starts where the ego's centre is at x."""
    position = x if lane.startswith("w") else 1000.0 - x
    return Mission(name=name, start=Place(lane=lane, position_m=position), goal=Place(lane=lane, position_m=-1.0))


def in_ingolstadt(**changes: object) -> Scenario:
    """Through the signalised junction, among cars and people."""
    mission = Mission(
        start=Place(lane="737320747#3_2", position_m=20.0), goal=Place(lane="726514449_2", position_m=-15.0)
    )
    defaults: dict[str, object] = {
        "network": "ingolstadt",
        "missions": (mission,),
        "traffic": Traffic(vehicles=30, bicycles=5, pedestrians=30, warm_up_s=10.0),
        "seed": 3,
    }
    return Scenario(**(defaults | changes))  # type: ignore[arg-type]


def driven(simulation: Simulation, command: Sequence[float] | FloatArray, seconds: float) -> list[World]:
    """The worlds while all egos obey one command."""
    commands = np.tile(np.asarray(command, dtype=np.float64), (len(simulation.plan.routes), 1))
    return [simulation.tick(commands) for _ in range(round(seconds * 10))]


def fingerprint(scenario: Scenario, ticks: int = 80) -> str:
    """A hash of everything that is true in every tick of a drive."""
    simulation = Simulation(plan_scenario(load_network(scenario.network), scenario))
    try:
        world, rng, digest = simulation.world, np.random.default_rng(0), hashlib.sha256()
        for _ in range(ticks):
            for part in (world.egos, world.actors):
                for field in dataclasses.fields(part):
                    value = getattr(part, field.name)
                    digest.update(value.tobytes() if isinstance(value, np.ndarray) else repr(value).encode())
            digest.update(world.signals.tobytes())
            digest.update(repr((world.tick, world.time, world.contacts, tuple(world.names))).encode())
            world = simulation.tick(rng.uniform((-1.0, -0.05), (3.0, 0.05), (len(simulation.plan.routes), 2)))
    finally:
        simulation.close()
    assert len(world.actors) > 3, "an empty road would prove nothing"
    return digest.hexdigest()


def busy_road(*missions: Mission, **changes: object) -> Scenario:
    """Forty vehicles on the straight road, and by default one ego that starts in its middle."""
    defaults: dict[str, object] = {"traffic": Traffic(vehicles=40, warm_up_s=20.0), "seed": 1}
    return on(straight_road(), *(missions or [standing_at(500.0)]), **(defaults | changes))


if __name__ == "__main__":
    print(fingerprint(Scenario.model_validate_json(sys.argv[1])))
