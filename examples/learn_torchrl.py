"""TorchRL's collector and actor, and a policy gradient: `python examples/learn_torchrl.py [STEPS]`."""

import sys

from tensordict.nn import NormalParamExtractor, TensorDictModule
from torch import nn, optim
from torchrl.collectors import Collector
from torchrl.modules import ProbabilisticActor, TanhNormal

from dohyo.evaluation.benchmarks.environments import single_scenarios
from dohyo.sumo_networks.envs.torchrl_env import make_torchrl_env

if __name__ == "__main__":  # each environment is a process, which imports this file
    env = make_torchrl_env(single_scenarios("quickstart", time_limit_s=60.0), 2, sensors=("route",))
    layers = nn.Flatten(-2), nn.Linear(560, 64), nn.Tanh(), nn.Linear(64, 4), NormalParamExtractor()
    module = TensorDictModule(nn.Sequential(*layers), ["route"], ["loc", "scale"])
    bounds = {"low": env.action_spec.space.low[0], "high": env.action_spec.space.high[0]}
    options = {"distribution_class": TanhNormal, "distribution_kwargs": bounds}
    actor = ProbabilisticActor(module, ["loc", "scale"], spec=env.action_spec, **options)
    optimizer = optim.Adam(actor.parameters(), 3e-4)
    for batch in Collector(env, actor, frames_per_batch=64, total_frames=int((sys.argv[1:] or [50_000])[0])):
        log_prob = actor.get_dist(batch).log_prob(batch["action"])
        loss = -(log_prob * batch["next", "reward"].squeeze(-1)).mean()
        loss.backward()
        optimizer.step(), optimizer.zero_grad()
        print(f"mean reward {batch['next', 'reward'].mean():.2f}", flush=True)
