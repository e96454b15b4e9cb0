"""A whole run of DDPG, step by step again in stable-baselines3: environment, replay, ends of episodes, and updates."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch
from stable_baselines3 import DDPG
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.logger import Logger
from tensordict import TensorDict

from dohyo.agents.learning.algorithms.ddpg import Ddpg, DdpgConfig
from dohyo.agents.learning.experience.collector import Collector
from dohyo.agents.learning.experience.replay import Replay, ReplayConfig
from dohyo.agents.learning.gymnasium.task import GymnasiumTask
from dohyo.agents.learning.tasks.task import Array, named
from dohyo.sumo_networks.seeds import training_seed

ENV, SEED = "Hopper-v5", 3
STEPS = 180
"""Few: a rounding error grows tenfold in ten updates, since Adam steps as far for the smallest gradient."""
CONFIG = DdpgConfig(replay=ReplayConfig(capacity=2000), round_steps=STEPS)


class _Noted(Collector):
    """Notes every step."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.taken: list[TensorDict] = []

    def receive(self) -> TensorDict:
        step = super().receive()
        self.taken.append(step.clone())
        return step


class _Drawn(Replay):
    """Notes which transitions are drawn, and after how many steps."""

    def __init__(self, *arguments: Any, collector: _Noted, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._collector = collector
        self.drawn: list[tuple[int, Array]] = []

    def sample(self, *arguments: Any) -> TensorDict:
        batch = super().sample(*arguments)
        self.drawn.append((len(self._collector.taken), batch["index"].numpy()))
        return batch


class _Seeded(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Episodes with the seeds of the run."""

    episode = 0

    def reset(self, **_: Any) -> Any:
        self.episode += 1
        return self.env.reset(seed=training_seed(SEED, self.episode - 1))


def _run(folder: Path) -> tuple[Ddpg, _Noted, _Drawn, tuple[list[torch.Tensor], ...]]:
    """A run of some rounds' steps, and the weights that it began with."""
    torch.manual_seed(SEED)
    task = GymnasiumTask(ENV)
    collector = _Noted(task.make_environments(1, processes=False), task, SEED)
    spaces = named(task.observation_space), task.action_space
    replay = _Drawn(folder, spaces, CONFIG.replay, gamma=CONFIG.gamma, slack=0, seed=SEED, collector=collector)
    ddpg = Ddpg(task, collector, replay, CONFIG, torch.device("cpu"))
    first = tuple([p.detach().clone() for p in module.parameters()] for module in (ddpg.actor, ddpg.critic))
    ddpg.begin()
    ddpg.round()
    return ddpg, collector, replay, first


def _peer(actor: list[torch.Tensor], critic: list[torch.Tensor]) -> DDPG:
    """stable-baselines3's learner with some weights, its environment begun."""
    peer = DDPG("MlpPolicy", make_vec_env(ENV, 1, wrapper_class=_Seeded), seed=0, device="cpu", buffer_size=2000)
    with torch.no_grad():
        for theirs, mine in zip(peer.actor.mu.parameters(), actor, strict=True):
            theirs.copy_(mine)
        for theirs, mine in zip(peer.critic.q_networks[0].parameters(), critic, strict=True):
            theirs.copy_(mine[0].T if mine.shape[1] > 1 else mine.reshape(theirs.shape))
    peer.actor_target.load_state_dict(peer.actor.state_dict())
    peer.critic_target.load_state_dict(peer.critic.state_dict())
    peer.set_logger(Logger(None, []))
    peer._last_obs = peer.env.reset()
    return peer


def test_a_run_is_the_same_in_stable_baselines3(tmp_path: Path) -> None:
    ddpg, collector, replay, first = _run(tmp_path)
    peer, drawn = _peer(*first), dict(replay.drawn)
    rows: dict[int, int] = {}  # from positions in our replay, where an episode's last observation has one, to theirs
    buffer: Any = peer.replay_buffer
    gather, position, episode = buffer._get_samples, -1, -1
    for number, step in enumerate(collector.taken):
        if number in drawn:  # ours learns while the environment steps, so before it has this step
            chosen = np.array([rows[place] for place in drawn[number].tolist()])
            buffer.sample = lambda count, env=None, chosen=chosen: gather(chosen, env)
            peer.train(1, CONFIG.batch)
        np.testing.assert_allclose(peer._last_obs, step["observation", "observation"], atol=1e-5)
        position += 2 if int(step["episode"]) != episode and number else 1
        episode, rows[position] = int(step["episode"]), number
        action = step["action"].numpy()
        observation, reward, done, infos = peer.env.step(action)
        assert reward[0] == step["next", "reward"].item()
        assert done[0] == step["next", "done"].item()
        peer._store_transition(buffer, peer.policy.scale_action(action), observation, reward, done, infos)
    assert len(drawn) == ddpg.updates == STEPS - CONFIG.learning_starts - 1
    assert episode >= 5, "episodes end in the run, by falling"
    seen = torch.cat([step["observation", "observation"] for step in collector.taken])
    action, mine = ddpg.actor(seen), ddpg.critic
    torch.testing.assert_close(peer.actor(seen), action, atol=1e-3, rtol=0.0)
    assert action.std() > 0.1
    torch.testing.assert_close(peer.critic(seen, action)[0][:, 0], mine(seen, action)[0], atol=0.02, rtol=0.0)
    assert mine(seen, action)[0].std() > 0.1
