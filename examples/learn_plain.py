"""A loop in CleanRL's style, without a library for learning: `python examples/learn_plain.py [STEPS]`."""

import sys

import torch
from gymnasium.wrappers.vector import FlattenObservation, RescaleAction

import dohyo

if __name__ == "__main__":  # each environment is a process, which imports this file
    steps = int(sys.argv[1]) if len(sys.argv) > 1 else 50_000
    if steps < 1:
        sys.exit(f"expected at least one step, got {steps}")
    envs = dohyo.make_vec("quickstart", num_envs=2, sensors=("speedometer", "route"), time_limit_s=60.0)
    envs = RescaleAction(FlattenObservation(envs), -1.0, 1.0)
    policy = torch.nn.Sequential(torch.nn.Linear(562, 64), torch.nn.Tanh(), torch.nn.Linear(64, 2))
    optimizer, (seen, _) = torch.optim.Adam(policy.parameters(), 3e-4), envs.reset(seed=1)
    for _ in range(steps):
        normal = torch.distributions.Normal(policy(torch.from_numpy(seen)), 0.3)
        seen, rewards, *_ = envs.step((action := normal.sample()).clamp(-1, 1).numpy())
        loss = -(normal.log_prob(action).sum(1) * torch.from_numpy(rewards)).mean()
        optimizer.zero_grad(), loss.backward(), optimizer.step()
    print(f"mean reward {rewards.mean():.2f}")
    envs.close()
