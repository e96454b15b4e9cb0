"""CommonRoad's multi-body model as the vehicle of an ego: 29 states, integrated here, between two ticks of a world.

    pip install commonroad-vehicle-models
    python examples/commonroad_plant.py http://127.0.0.1:8000 TOKEN WORLD EGO 8.0

The last argument is the speed to keep, m/s, at least 4. A pure-pursuit driver follows the route with it.
"""

from __future__ import annotations

import math
from typing import Any

from scipy.integrate import odeint
from vehiclemodels.init_mb import init_mb
from vehiclemodels.parameters_vehicle1 import parameters_vehicle1
from vehiclemodels.vehicle_dynamics_ks import vehicle_dynamics_ks
from vehiclemodels.vehicle_dynamics_mb import vehicle_dynamics_mb
from world_worker import leave, post, run, speed_of, told

STEERING_GAIN = 5.0  # 1/s
SPEED_GAIN = 1.5  # 1/s
SLOWEST_MPS = 3.0  # the tyres of the multi-body model need a motion; below, CommonRoad's kinematic model drives


class Plant:
    """A Ford Escort: position, steering angle, speed and heading; from 3 m/s on also the other 24 states."""

    def __init__(self, ego: dict[str, Any]) -> None:
        """Begins where the ego is and as fast, by its row among the actors of the world."""
        self.parameters = parameters_vehicle1()
        self.ahead_m = 0.5 * (self.parameters.b - self.parameters.a)  # from the box's centre to the centre of mass
        heading = ego["heading_rad"]
        x, y = ego["x_m"] + self.ahead_m * math.cos(heading), ego["y_m"] + self.ahead_m * math.sin(heading)
        self.state: list[float] = [x, y, 0.0, ego["speed_mps"], heading]

    @property
    def multi_body(self) -> bool:
        """Whether the multi-body model drives."""
        return len(self.state) > 5

    @property
    def pose(self) -> list[float]:
        """Centre of the box, heading and velocity, as the control `pose` takes them."""
        x, y, _, along, heading = self.state[:5]
        aside = self.state[10] - self.state[5] * self.ahead_m if self.multi_body else 0.0
        cos, sin = math.cos(heading), math.sin(heading)
        velocity = [along * cos - aside * sin, along * sin + aside * cos]
        return [x - self.ahead_m * cos, y - self.ahead_m * sin, heading, *velocity]

    def advance(self, steering_rad: float, speed_mps: float, seconds: float) -> None:
        """Steers and accelerates towards what the driver wants, for a time."""
        if not self.multi_body and self.state[3] >= SLOWEST_MPS:
            self.state = init_mb([*self.state, 0.0, 0.0], self.parameters)
        dynamics = vehicle_dynamics_mb if self.multi_body else vehicle_dynamics_ks
        inputs = [STEERING_GAIN * (steering_rad - self.state[2]), SPEED_GAIN * (speed_mps - self.state[3])]
        states = odeint(lambda x, t: dynamics(x, inputs, self.parameters), self.state, [0.0, seconds])
        self.state = states[-1].tolist()

    def steering_to(self, route: list[list[float]]) -> float:
        """Angle of the front wheels that leads to a point of the route."""
        x, y = route[min(len(route) - 1, round(3.0 + 0.6 * self.state[3]))][:2]
        wheelbase = self.parameters.a + self.parameters.b
        x += 0.5 * wheelbase
        return math.atan2(2.0 * wheelbase * y, x * x + y * y)


def main() -> None:
    """Joins a world, and simulates the ego's vehicle until its drive has ended."""
    server, token, world, ego, speed = told("SERVER TOKEN WORLD EGO SPEED")
    speed_mps = speed_of(speed)
    asked = {"name": f"plant-{ego}", "egos": [ego], "sensors": ["route"], "control": "pose", "coupled": True}
    seat = post(f"{server}/v1/worlds/{world}/join", token, asked)
    print(f"{ego} is simulated from tick {seat['tick']}", flush=True)
    reply: dict[str, Any] = seat | {"done": False}
    resets = -1
    try:
        while not reply["done"]:
            if reply["resets"] != resets:  # at the beginning, and when the world has begun anew
                (row,) = [one for one in reply["actors"] if one["name"] == f"ego:{ego}"]
                plant, resets = Plant(row), reply["resets"]
            plant.advance(plant.steering_to(reply["observations"][ego]["route"]), speed_mps, seat["dt_s"])
            step = {"tick": reply["tick"], "resets": reply["resets"], "actions": {ego: plant.pose}}
            reply = post(f"{server}/v1/seats/{seat['seat']}/step", seat["token"], step)
    finally:  # also at Ctrl-C: the world would wait for a pose at each tick
        leave(server, seat)
    print(f"{ego} has ended at tick {reply['tick']}", flush=True)


if __name__ == "__main__":
    run(main)
