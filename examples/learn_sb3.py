"""Stable-Baselines3's PPO on the missions of quickstart: `python examples/learn_sb3.py [STEPS]`."""

import sys

import gymnasium
from gymnasium.wrappers import FlattenObservation, RescaleAction
from stable_baselines3 import PPO

import dohyo

gymnasium.register_envs(dohyo)
env = gymnasium.make("dohyo/Quickstart-v0", sensors=("speedometer", "route"), time_limit_s=60.0)
env = RescaleAction(FlattenObservation(env), -1.0, 1.0)
model = PPO("MlpPolicy", env, n_steps=64, verbose=1, device="cpu")
model.learn(int(sys.argv[1]) if len(sys.argv) > 1 else 100_000)
env.close()
