"""A bridge between CARLA and a world at a dohyo service: CARLA simulates the ego's vehicle and actors of its own.

    python examples/carla_bridge.py http://127.0.0.1:8000 TOKEN WORLD EGO [HOST PORT]

The vehicle of role "hero" in CARLA is the ego. CARLA's other vehicles and walkers are actors in the world, to which
SUMO's traffic yields. All others of the world are shown in CARLA as vehicles without physics.

Both need the same roads: a network made from CARLA's map, such as with netconvert --opendrive. CARLA's frame is
left-handed: its y and yaw have the opposite sign. The network's offset, which netconvert adds to the coordinates of its
source, is taken into account; the service tells it.

It is written for the Python API of CARLA 0.9.15 as documented, and has been run with a stand-in only, never with CARLA.
"""

from __future__ import annotations

import math
import sys
from typing import Any

from world_worker import get, leave, post

Row = dict[str, Any]
TICK_S = 0.1
HERO = "hero"
OURS = "dohyo"
BLUEPRINTS = {
    "car": "vehicle.tesla.model3",
    "van": "vehicle.mercedes.sprinter",
    "truck": "vehicle.carlamotors.carlacola",
    "bus": "vehicle.mitsubishi.fusorosa",
    "bicycle": "vehicle.bh.crossbike",
    "emergency": "vehicle.ford.ambulance",
    "pedestrian": "walker.pedestrian.0001",
}


def offset_of(server: str, token: str, world: str) -> tuple[float, float]:
    """x, y of the origin of CARLA's map in the network of a world, m."""
    network = get(f"{server}/v1/worlds/{world}", token)["network"]
    x, y = get(f"{server}/v1/networks/{network}", token)["net_offset"]
    return x, y


class Frames:
    """From the frame of CARLA to that of the network, and back."""

    def __init__(self, carla: Any, offset_m: tuple[float, float]) -> None:
        self.carla, self.offset_m = carla, offset_m

    def row(self, actor: Any) -> Row:
        """An actor of CARLA as a row of the world; the box's centre may be ahead of the actor's origin."""
        place, velocity, box = actor.get_transform(), actor.get_velocity(), actor.bounding_box
        heading = -math.radians(place.rotation.yaw)
        x = place.location.x + self.offset_m[0] + box.location.x * math.cos(heading)
        y = -place.location.y + self.offset_m[1] + box.location.x * math.sin(heading)
        along = velocity.x * math.cos(heading) - velocity.y * math.sin(heading)
        size = {"length_m": 2.0 * box.extent.x, "width_m": 2.0 * box.extent.y}
        on_two = actor.attributes.get("number_of_wheels") == "2"
        kind = "pedestrian" if actor.type_id.startswith("walker.") else "bicycle" if on_two else "car"
        moving = {"heading_rad": heading, "speed_mps": max(along, 0.0)}
        return {"name": f"carla-{actor.id}", "kind": kind, "x_m": x, "y_m": y} | moving | size

    def pose(self, actor: Any) -> list[float]:
        """The same for the control `pose`."""
        row, velocity = self.row(actor), actor.get_velocity()
        return [row["x_m"], row["y_m"], row["heading_rad"], velocity.x, -velocity.y]

    def transform(self, row: Row, ground: Any) -> Any:
        """A row of the world as a place in CARLA, on the ground."""
        location = self.carla.Location(row["x_m"] - self.offset_m[0], -(row["y_m"] - self.offset_m[1]), 0.0)
        location.z = ground.get_waypoint(location).transform.location.z
        return self.carla.Transform(location, self.carla.Rotation(yaw=-math.degrees(row["heading_rad"])))


class Bridge:
    """CARLA in synchronous mode, with the others of the world as vehicles without physics."""

    def __init__(self, carla: Any, client: Any, offset_m: tuple[float, float]) -> None:
        self.world, self.frames = client.get_world(), Frames(carla, offset_m)
        self.ground = self.world.get_map()
        self.before = self.world.get_settings()
        settings = self.world.get_settings()
        settings.synchronous_mode, settings.fixed_delta_seconds = True, TICK_S
        self.world.apply_settings(settings)
        self.shown: dict[str, Any] = {}

    def own(self) -> list[Any]:
        """CARLA's own vehicles and walkers."""
        actors = self.world.get_actors()
        found = [*actors.filter("vehicle.*"), *actors.filter("walker.pedestrian.*")]
        return [one for one in found if one.attributes.get("role_name") != OURS]

    def hero(self) -> Any:
        """The vehicle that is the ego."""
        (found,) = [one for one in self.own() if one.attributes.get("role_name") == HERO]
        return found

    def show(self, rows: list[Row]) -> None:
        """Shows the others of the world in CARLA."""
        for row in rows:
            place = self.frames.transform(row, self.ground)
            if row["name"] in self.shown:
                self.shown[row["name"]].set_transform(place)
            elif (made := self._spawned(row, place)) is not None:
                self.shown[row["name"]] = made
        for gone in self.shown.keys() - {row["name"] for row in rows}:
            self.shown.pop(gone).destroy()

    def _spawned(self, row: Row, place: Any) -> Any:
        """A new actor; None where CARLA finds no room, to try again at the next tick."""
        blueprint = self.world.get_blueprint_library().find(BLUEPRINTS.get(row["kind"], BLUEPRINTS["car"]))
        if blueprint.has_attribute("role_name"):
            blueprint.set_attribute("role_name", OURS)
        made = self.world.try_spawn_actor(blueprint, place)
        if made is not None:
            made.set_simulate_physics(False)
        return made

    def close(self) -> None:
        """Leaves CARLA as it was."""
        for one in self.shown.values():
            one.destroy()
        self.world.apply_settings(self.before)


def couple(bridge: Bridge, server: str, token: str, world: str, ego: str) -> int:
    """Ticks both simulators until the ego's drive has ended; returns the last tick."""
    asked = {"name": "carla", "egos": [ego], "sensors": ["speedometer"], "control": "pose", "coupled": True}
    seat = post(f"{server}/v1/worlds/{world}/join", token, asked)
    reply: Row = seat | {"done": False}
    there: set[str] = set()
    try:
        while not reply["done"]:
            bridge.show([row for row in reply["actors"] if row["name"] != f"ego:{ego}"])
            bridge.world.tick()
            hero = bridge.hero()
            put = [bridge.frames.row(one) for one in bridge.own() if one.id != hero.id]
            names = {row["name"] for row in put}
            actors = {"put": put, "remove": sorted(there - names)}
            now = {"tick": reply["tick"], "resets": reply["resets"]}
            step = now | {"actions": {ego: bridge.frames.pose(hero)}, "actors": actors}
            reply, there = post(f"{server}/v1/seats/{seat['seat']}/step", seat["token"], step), names
    finally:  # also at Ctrl-C: CARLA's actors go, and the world does not wait for them at each tick
        leave(server, seat)
    return int(reply["tick"])


def main() -> None:
    """Connects to CARLA and couples it."""
    if len(sys.argv) not in (5, 7):
        sys.exit(__doc__)
    import carla  # from the package of CARLA's release

    server, token, world, ego, *address = sys.argv[1:]
    host, port = address or ("127.0.0.1", "2000")
    client = carla.Client(host, int(port))
    client.set_timeout(20.0)
    bridge = Bridge(carla, client, offset_of(server, token, world))
    try:
        couple(bridge, server, token, world, ego)
    finally:
        bridge.close()


if __name__ == "__main__":
    main()
