"""Drives agents through hand-made scenes: the others move as told, the ego as its agent wants; no SUMO."""

from __future__ import annotations

import dataclasses

import numpy as np

from dohyo.evaluation.agent import Agent, make_agent
from dohyo.sumo_networks.ego.control import make_control
from dohyo.sumo_networks.ego.dynamics import HEADING, SPEED, STEERING, VehicleParameters, Vehicles
from dohyo.sumo_networks.geometry import wrap_angle
from dohyo.sumo_networks.sensors import Track, make_sensors
from dohyo.sumo_networks.units import TICK_S
from dohyo.sumo_networks.world import Egos, World
from tests.worlds import Scene, _contacts


def observed(agent: Agent, world: World) -> dict[str, np.ndarray]:
    """What an agent would see as the first ego of a world."""
    sensors = make_sensors(agent.spec.sensors, Track[agent.spec.track.upper()])
    return {sensor.name: sensor.read(world, 0) for sensor in sensors}


def brakes_for_a_second_stop_sign(agent: Agent, scene: Scene) -> list[bool]:
    """Whether it brakes for a stop sign behind the next junction: as it comes, as it stands there, and then."""
    agent.reset(scene.mission, 0)
    observation, out = observed(agent, scene.world()), []
    for speed, stop in [(8.0, 14.0), (0.0, 1.5), (1.0, 1.4)]:
        observation["junctions_ahead"][:2] = [[stop - 9.0, stop + 1.5, -1.0, 0.0], [stop, stop + 9.0, -1.0, 2.0]]
        observation["speedometer"][0] = speed
        out.append(bool(agent.act(observation)[0] < 0.5))
    return out


def drive(agent: Agent, scene: Scene, seconds: float) -> list[World]:
    """The world at the start and after every tick."""
    car, (first, *others) = VehicleParameters(), scene.worlds(seconds)
    vehicles, control = Vehicles(car, 1), make_control(agent.spec.control, car, TICK_S)
    vehicles.place(0, *first.egos.position[0].tolist(), float(first.egos.heading[0]))
    vehicles.states[0, SPEED] = first.egos.speed[0]
    sensors = make_sensors(agent.spec.sensors, Track[agent.spec.track.upper()])
    agent.reset(scene.mission, 0)
    worlds = [first]
    for told in others:
        before = worlds[-1]
        action = agent.act({sensor.name: sensor.read(before, 0) for sensor in sensors})
        vehicles.advance(np.array([control.command(action, before, 0)]), TICK_S)
        egos = _moved(told, before, vehicles)
        worlds.append(dataclasses.replace(told, egos=egos, contacts=_contacts(egos, told.actors)))
    return worlds


def _moved(told: World, before: World, vehicles: Vehicles) -> Egos:
    state, centre, route = vehicles.states[0], vehicles.centres(), told.routes[0]
    progress, lateral, direction = route.project(*centre[0].tolist(), float(before.egos.progress[0]))
    lane, offset, error = told.network.nearest_lane(*centre[0].tolist(), float(state[HEADING]), route.on_route)
    return dataclasses.replace(
        told.egos,
        position=centre,
        heading=np.array([state[HEADING]]),
        speed=np.array([state[SPEED]]),
        steering=np.array([state[STEERING]]),
        progress=np.array([progress]),
        lateral=np.array([lateral]),
        route_heading_error=wrap_angle(np.array([state[HEADING] - direction])),
        lane=np.array([lane]),
        lane_offset=np.array([offset]),
        lane_heading_error=np.array([error]),
    )


def made(name: str) -> Agent:
    """An expert by its class name."""
    return make_agent(f"dohyo.agents.experts.{name.lower()}:{name}")


def fronts(worlds: list[World]) -> np.ndarray:
    """x of the ego's front bumper, for drives to the east, m."""
    return np.array([world.egos.position[0, 0] + world.egos.length[0] / 2 for world in worlds])


def speeds(worlds: list[World]) -> np.ndarray:
    """The ego's speed, m/s."""
    return np.array([world.egos.speed[0] for world in worlds])


def touched(worlds: list[World]) -> set[int]:
    """Keys of all whom the ego touched."""
    return {contact.key for world in worlds for contact in world.contacts}
