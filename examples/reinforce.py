"""An algorithm of one's own: REINFORCE (Williams 1992), on any gymnasium environment of vectors.

dohyo train examples.reinforce:REINFORCE --set env=CartPole-v1 --out runs/reinforce
"""

import torch
from tensordict import TensorDict
from torchrl.objectives.value.functional import reward2go

from dohyo.agents.learning.experience.behaviour import PolicyBehaviour
from dohyo.agents.learning.gymnasium.task import GymnasiumTask
from dohyo.agents.learning.networks.modules import ObservationEncoder
from dohyo.agents.learning.networks.policy import actor_for, joined
from dohyo.agents.learning.runs.config import RunConfig
from dohyo.agents.learning.runs.trainer import Trainer
from dohyo.agents.learning.runs.training import train_task
from dohyo.agents.learning.tasks.task import named


class ReinforceConfig(RunConfig):
    """Settings; those of every run come with `RunConfig`."""

    env: str = "CartPole-v1"
    steps: int = 40_000
    processes: int = 0
    environments: int = 8
    learning_rate: float = 5e-3
    gamma: float = 0.99
    horizon: int = 256


class Reinforce:
    """Raises the probability of actions by the rewards that followed them."""

    columns = ("updates", "episodes", "return", "loss")

    def __init__(self, task, collector, config):
        self.collector, self.config, self.updates = collector, config, 0
        features = ObservationEncoder(named(task.observation_space)).features
        self.policy = actor_for(features, task.action_space, (64,), std=0.5, squashed=False)
        self.optimizer = torch.optim.Adam(self.policy.parameters(), config.learning_rate)
        self.behaviour = PolicyBehaviour(self.explore)

    def begin(self):
        """Nothing comes before the first round."""

    def explore(self, observation):
        """Draws an action for each row; the variable is what the density is of."""
        with torch.no_grad():
            variable = self.policy.sample(joined(observation))
        return TensorDict({"action": self.policy.action_of(variable), "variable": variable}, observation.batch_size)

    def round(self):
        """Drives, then takes one gradient step; returns a row of metrics.csv."""
        steps = [self.collector.step(self.behaviour) for _ in self.collector.round(self.config.horizon)]
        batch = TensorDict.stack(steps, dim=1)  # (N, T)
        later = reward2go(batch["next", "reward"], batch["next", "done"], self.config.gamma, time_dim=1)[..., 0]
        parameters = self.policy.parameters_at(joined(batch["observation"]))
        density = self.policy.distribution(**dict(zip(self.policy.parameter_names, parameters, strict=True)))
        log_prob = density.log_prob(batch["variable"])
        loss = -(log_prob * (later - later.mean()) / later.std()).mean()
        self.optimizer.zero_grad()
        loss.backward()
        self.optimizer.step()
        self.updates += 1
        returns = [episode.total for episode in self.collector.finished()]
        mean = sum(returns) / len(returns) if returns else None
        episodes = self.collector.finished_count
        return {"updates": self.updates, "episodes": episodes, "return": mean, "loss": loss.item()}

    def act(self, observation):
        """Actions without exploration, for the held-out episodes."""
        with torch.no_grad():
            return self.policy(joined(observation)).numpy()

    def state(self):
        """What a checkpoint keeps."""
        parts = {"policy": self.policy.state_dict(), "optimizer": self.optimizer.state_dict()}
        return parts | {"updates": self.updates}

    def restore(self, state):
        """Continues from a checkpoint."""
        self.policy.load_state_dict(state["policy"])
        self.optimizer.load_state_dict(state["optimizer"])
        self.updates = state["updates"]


def train_reinforce(config, request):
    """Trains, and returns the best policy's file."""
    task = GymnasiumTask(config.env)
    return train_task(lambda collector, run: Reinforce(task, collector, config), task, config, request)


REINFORCE = Trainer("REINFORCE on a gymnasium environment", ReinforceConfig, train_reinforce)
