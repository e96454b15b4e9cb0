"""Lane keeper: follows its route, and stops at red lights and for others in its path. The README's example."""

import math

import numpy as np

from dohyo.evaluation.agent import Agent, AgentSpec

SENSORS = ("route", "objects", "junctions_ahead")


class LaneKeeper(Agent):
    """Steers along the route, and drives only as fast as the free metres ahead allow."""

    spec = AgentSpec(name="lane-keeper", track="privileged", sensors=SENSORS, control="target_speed_steering")

    def reset(self, mission, seed):
        """Does nothing: the agent has no state."""

    def act(self, observation):
        """One decision: target speed [m/s] and steering [-1, 1]."""
        path, objects, light = observation["route"], observation["objects"], observation["junctions_ahead"][0]
        others = objects[objects[:, 0] >= 0, 1:3]  # x, y in the ego's frame, m
        gaps = np.linalg.norm(path[:40, None, :2] - others, axis=2)  # (40, N) from points of the path to the others, m
        blocked = np.flatnonzero((gaps < 2.0).any(axis=1))
        free = blocked[0] - 5.0 if len(blocked) else 40.0
        if light[2] == 1 and light[0] > 0.0:  # red, and its stop line is ahead
            free = min(free, light[0] - 1.0)
        x, y = path[6, :2]
        steering = math.atan2(2 * 2.7 * y, x * x + y * y) / 0.6  # wheelbase [m], angle at full lock [rad]
        return np.array([min(path[0, 4], max(free, 0.0) * 0.6), steering])
