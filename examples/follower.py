"""A policy of one's own: what it observes, the task that it learns, and the agent that it becomes.

dohyo train examples.follower:FOLLOWER --out runs/follower
dohyo evaluate --agent examples.follower:Follower --benchmark quickstart
"""

from dataclasses import dataclass
from pathlib import Path

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict

from dohyo.agents.learning.algorithms.ppo import ppo_trainer
from dohyo.agents.learning.algorithms.ppo_config import PpoConfig, PpoRunConfig
from dohyo.agents.learning.policies.policy_agent import AsControl, PolicyAgent, SensorEncoder
from dohyo.agents.learning.tasks.task import Task, held_out_seeds
from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.sumo_networks.envs.driving_env import DrivingEnv

CONTROL = "target_speed_steering"


class RouteAhead(SensorEncoder):
    """The route at every fifth metre up to 45 m, in the ego's frame, and the speed."""

    track = "map"
    sensors = ("speedometer", "route")
    space = Dict(points=Box(-np.inf, np.inf, (18,), np.float32), speed=Box(-np.inf, np.inf, (1,), np.float32))

    def encode(self, observation):
        """Numbers of about unit scale."""
        points, speed = observation["route"][5:50:5, :2], observation["speedometer"][:1]
        return {"points": points.ravel() / 50.0, "speed": speed / 10.0}


@dataclass(frozen=True)
class Following(Task):
    """Drives the missions of quickstart, rewarded for speed and a small distance from the route."""

    name = "following"
    observation_space = RouteAhead.space
    action_space = Box(np.array([0.0, -0.5], np.float32), np.array([8.0, 0.5], np.float32))  # m/s, share of full lock
    held_out = held_out_seeds(6)
    alone = True  # libsumo is global to its process

    def make_env(self, rank):
        """One environment, in a process of its own."""
        return FollowingEnv()


class FollowingEnv(gymnasium.Env):
    """One mission after the other; the seed chooses the mission and the traffic."""

    observation_space, action_space = Following.observation_space, Following.action_space

    def reset(self, *, seed=None, options=None):
        """Begins the mission of a seed."""
        self.close()
        scenario = load_benchmark("quickstart").scenarios([seed])[seed % 6].model_copy(update={"time_limit_s": 30.0})
        self.driving, self.encoder = DrivingEnv(scenario, RouteAhead.sensors, CONTROL), RouteAhead()
        return self.encoder.encode(self.driving.reset(seed=seed)[0]["ego"]), {}

    def step(self, action):
        """Drives one tick."""
        observations, rewards, terminated, truncated, infos = self.driving.step({"ego": action})
        seen = self.encoder.encode(observations["ego"])
        return seen, rewards["ego"], terminated["ego"], truncated["ego"], infos["ego"]

    def close(self):
        """Ends the simulation."""
        if hasattr(self, "driving"):
            self.driving.close()


class FollowerConfig(PpoRunConfig):
    """Twenty thousand steps: 33 minutes of driving."""

    steps: int = 20_000
    evaluate_every: int = 10_000
    checkpoint_every: int = 10_000
    ppo: PpoConfig = PpoConfig(
        horizon=1024, batch=128, learning_rate=3e-4, initial_std=0.5, normalised=True, reward_scale=0.1
    )


FOLLOWER = ppo_trainer("follows the route of quickstart", FollowerConfig, lambda config: Following())


class Follower(PolicyAgent):
    """Drives by the policy of a run."""

    def __init__(self, policy: str = "runs/follower/best.onnx"):
        super().__init__("follower", Path(policy), RouteAhead(), AsControl(CONTROL))
