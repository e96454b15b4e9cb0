"""Training of the master: option-critic over the trained sub-policies, on missions through town.

    dohyo train hierarchical-master --config agents/hierarchical/configs/master.toml --set options=runs/ghrl

Per round: some ticks in all environments, epsilon-greedy; then Q-learning on the options that ended so far, from every
state on their way (SMDP, from a replay, with a target network), and some steps of the termination gradient and one of
the intra-option gradient on the round's own ticks. Rewards are scaled by 1 - gamma, so that a value is a mean reward
per tick. Source: Albilani 2023, algorithm 11; Bacon et al. 2017; Harb et al. 2018.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import torch
from pydantic import Field
from tensordict import TensorDict
from torch import Tensor

from dohyo.agents.hierarchical.environments.mission_env import HELD_OUT, MissionTask
from dohyo.agents.hierarchical.environments.rewards import Form
from dohyo.agents.hierarchical.hierarchy import read_sub_policies
from dohyo.agents.hierarchical.master import Master, MasterView, master_of, parts
from dohyo.agents.hierarchical.options.actuation import ACTIONS
from dohyo.agents.hierarchical.options.executor import OptionExecutor, OptionLimits, OptionView
from dohyo.agents.hierarchical.options.rollout import OptionRollout
from dohyo.agents.hierarchical.state.master_observation import OPTIONS
from dohyo.agents.hierarchical.training.option_losses import (
    OptionReplay,
    arrival_value,
    best_value,
    intra_option_loss,
    smdp_target,
    termination_loss,
)
from dohyo.agents.learning.experience.behaviour import Act, PolicyBehaviour
from dohyo.agents.learning.experience.collector import Collector, Finished
from dohyo.agents.learning.files.checkpoint import generator_of, generator_state
from dohyo.agents.learning.files.metrics import Number
from dohyo.agents.learning.policies.export import Exportable
from dohyo.agents.learning.runs.config import Positive, RunConfig, Share
from dohyo.agents.learning.runs.run import TaskRun
from dohyo.agents.learning.runs.trainer import Trainer, TrainRequest
from dohyo.agents.learning.runs.training import train_task
from dohyo.agents.learning.tasks.task import SINGLE, Array
from dohyo.sumo_networks.arrays import BoolArray, Float32Array, IntArray
from dohyo.sumo_networks.config import Config

Rate = Annotated[float, Field(ge=0)]
_CHOICES = 1  # separates this random stream from the environments'


class OptionCriticConfig(Config):
    """Settings of the learner; where the thesis says nothing, all of them are ours.

    Attributes:
        horizon: Ticks of every environment between two updates: a round.
        gamma: Discount per tick.
        epsilon: Probability of a random option, at the start.
        epsilon_end: The same at the end of its fall.
        epsilon_steps: Ticks over which it falls.
        deliberation_cost: eta, in mean rewards per tick.
        learning_rate: Of Q_Omega.
        termination_learning_rate: Of beta.
        termination_updates: Gradient steps of beta per round.
        intra_option_learning_rate: Of the sub-policies; 0, as in all shipped masters: they stay unchanged.
        batch: Options per gradient step of Q_Omega.
        updates: Gradient steps of Q_Omega per round.
        replay: Number of ticks of finished options that are kept.
        target_share: Rate at which the target network follows in each step.
        hidden: Width of each hidden layer.
        tempo: Duration of options.
    """

    horizon: Positive = 128
    gamma: Share = 0.99
    epsilon: Share = 0.3
    epsilon_end: Share = 0.05
    epsilon_steps: Positive = 100_000
    deliberation_cost: Rate = 0.005
    learning_rate: Rate = 3e-4
    termination_learning_rate: Rate = 1e-4
    termination_updates: Positive = 1
    intra_option_learning_rate: Rate = 1e-5
    batch: Positive = 64
    updates: Positive = 16
    replay: Positive = 200_000
    target_share: Share = 0.01
    hidden: Annotated[tuple[Positive, ...], Field(min_length=1)] = (256, 256)
    tempo: OptionLimits = OptionLimits()

    def epsilon_at(self, step: int) -> float:
        """Epsilon after some ticks."""
        share = min(step / self.epsilon_steps, 1.0)
        return self.epsilon + (self.epsilon_end - self.epsilon) * share


class MasterConfig(RunConfig):
    """A training of the master.

    Attributes:
        options: Folder of the sub-policies' runs.
        rules_when_critical: Whether the rules drive in critical intervals (GHRL-R).
        form: Of the reward, in training; held-out episodes are judged by the product.
        held_out: Episodes of an evaluation.
        option_critic: Of the learner.
    """

    options: Path
    rules_when_critical: bool = False
    form: Form = "product"
    held_out: Annotated[int, Field(gt=0, le=1000)] = HELD_OUT
    option_critic: OptionCriticConfig = OptionCriticConfig()


@dataclass(slots=True)
class _Ticks:
    """Ticks of a round that were driven by options, one row each."""

    before: list[Float32Array] = field(default_factory=list)
    after: list[Float32Array] = field(default_factory=list)
    units: list[Tensor] = field(default_factory=list)
    options: list[int] = field(default_factory=list)
    rewards: list[float] = field(default_factory=list)
    terminated: list[bool] = field(default_factory=list)
    available: list[BoolArray] = field(default_factory=list)


class _Choice(NamedTuple):
    """What was chosen in the rows that act in one tick, and the durations of the options that had ended before it."""

    rows: list[int]
    told: list[MasterView]
    options: list[int]
    units: list[Tensor]
    ended: list[int]


class _Acting(PolicyBehaviour):
    """The policy drives.

    Attributes:
        rows: (N,) rows whose episode has begun and not ended; others sit out.
    """

    def __init__(self, policy: Act, count: int) -> None:
        super().__init__(policy)
        self.rows: BoolArray = np.zeros(count, np.bool_)

    def begin(self, rows: BoolArray, episodes: IntArray) -> None:
        """See `Behaviour`."""
        self.rows |= rows


class OptionCritic:
    """The learner.

    Attributes:
        actor: The master, with its sub-policies.
        updates: Gradient steps of Q_Omega so far.
    """

    columns = (
        *("updates", "episodes", "return", "length", "success", "epsilon", "replay", "q", "loss_q"),
        *("beta", "loss_beta", "option_ticks", "critical_share", *(f"share_{option}" for option in OPTIONS)),
    )

    def __init__(
        self, master: Master, collector: Collector, config: OptionCriticConfig, seed: int, device: torch.device
    ) -> None:
        """Prepares the learner.

        Args:
            master: Untrained, over trained sub-policies.
            collector: Of a `MissionTask`.
            config: Settings.
            seed: Of the run.
            device: Of the networks.
        """
        self._collector, self._config, self._device = collector, config, device
        self.actor, self.updates, self._epsilon = master.to(device), 0, config.epsilon
        self.policy: Exportable = self.actor
        self._target = copy.deepcopy(master.values).to(device)
        self._running = [OptionRollout(OptionExecutor(config.tempo)) for _ in range(len(collector))]
        self._judged: list[OptionExecutor] = []
        self._behaviour = _Acting(self._choose, len(collector))
        self._now = _Choice([], [], [], [], [])
        self._replay = OptionReplay(config.replay)
        self._rng = np.random.default_rng([_CHOICES, seed])
        self._optimizers = {
            "q": torch.optim.Adam(master.values.values.parameters(), lr=config.learning_rate),
            "beta": torch.optim.Adam(master.values.endings.parameters(), lr=config.termination_learning_rate),
            "options": torch.optim.Adam(master.actors.parameters(), lr=config.intra_option_learning_rate),
        }

    def begin(self) -> None:
        """Nothing comes before the first round."""

    def act(self, observation: TensorDict) -> Array:
        """(N, ...) observations -> (N, 3) actions, without exploration; a row drives one episode after the other."""
        vectors = observation[SINGLE].numpy()
        while len(self._judged) < len(vectors):
            self._judged.append(OptionExecutor(self._config.tempo))
        answers = self._answer(vectors)
        rows = zip(self._judged, vectors, answers, strict=False)
        return np.stack([self._judge(executor, vector, answer) for executor, vector, answer in rows])

    def _judge(self, executor: OptionExecutor, vector: Float32Array, answer: Float32Array) -> Float32Array:
        """(3,) action of one row."""
        told = MasterView(vector, self.actor.size)
        if told.fresh:
            executor.reset()
        q, beta, actions = parts(answer)
        prospect = OptionView(q, beta, told.available, told.finished, told.critical)
        option = executor.begin(prospect) if executor.ends(prospect, 0.5) else executor.option
        assert option is not None
        executor.tick()
        return np.array([*actions[option], option], dtype=np.float32)

    def round(self) -> dict[str, Number]:
        """Drives `horizon` ticks in all environments, and learns from them; row of metrics.csv."""
        self._epsilon = epsilon = self._config.epsilon_at(self._collector.steps)
        ticks, ended, driven, critical = _Ticks(), list[int](), 0, 0
        for _ in self._collector.round(self._config.horizon):
            acted, ruled = self._tick(ticks, ended)
            driven, critical = driven + acted, critical + ruled
        finished: list[Finished] = self._collector.finished()
        row = self._learn_values() | self._learn_ticks(ticks)
        driven = max(driven, 1)
        row |= {f"share_{name}": ticks.options.count(i) / driven for i, name in enumerate(OPTIONS)}
        row |= {"critical_share": critical / driven, "option_ticks": _mean(ended), "epsilon": epsilon}
        row |= {"return": _mean([one.total for one in finished]), "length": _mean([one.length for one in finished])}
        row |= {"success": _mean([100.0 * one.success for one in finished]), "updates": self.updates}
        return row | {"episodes": self._collector.finished_count, "replay": len(self._replay)}

    def _tick(self, ticks: _Ticks, ended: list[int]) -> tuple[int, int]:
        """One tick in all rows that act; their number, and that of those in which the rules drove."""
        step = self._collector.step(self._behaviour)
        ended += self._now.ended
        afters, active = step["next", "observation", SINGLE].numpy(), step["active"].tolist()
        rewards, terminated, done = (step["next", name][:, 0].tolist() for name in ("reward", "terminated", "done"))
        acted = ruled = 0
        for i, one, option, unit in zip(*self._now[:4], strict=True):
            running, after = self._running[i], MasterView(afters[i], self.actor.size)
            self._behaviour.rows[i] = not done[i]
            if not active[i]:  # its simulation is lost, and with it the outcome of its option
                _forget(running)
                continue
            acted += 1
            ruled += one.critical
            reward = rewards[i] * (1.0 - self._config.gamma)
            running.add(None if one.critical else one.state, reward)
            if done[i]:
                self._keep(running, after, terminated[i], ended)
            if not one.critical:
                ticks.before.append(one.state)
                ticks.after.append(after.state)
                ticks.units.append(unit)
                ticks.options.append(option)
                ticks.rewards.append(reward)
                ticks.terminated.append(terminated[i])
                ticks.available.append(after.available)
        return acted, ruled

    def _choose(self, observation: TensorDict) -> TensorDict:
        """Options and actions of the rows that act, kept for `_tick`; zeros for those that sit out."""
        rows, ended = np.flatnonzero(self._behaviour.rows).tolist(), list[int]()
        views = [MasterView(vector, self.actor.size) for vector in observation[SINGLE].numpy()]
        values, told = self._values(np.stack([one.state for one in views])), [views[i] for i in rows]
        options = [self._next(i, views[i], values, self._epsilon, ended) for i in rows]
        units = [self._explored(option, one.state) for option, one in zip(options, told, strict=True)]
        actions = torch.zeros(len(views), ACTIONS + 1)
        for i, option, unit in zip(rows, options, units, strict=True):
            actions[i] = torch.tensor([*unit.clamp(-1.0, 1.0).tolist(), float(option)])
        self._now = _Choice(rows, told, options, units, ended)
        return TensorDict({"action": actions}, observation.batch_size)

    def _next(
        self, i: int, told: MasterView, values: tuple[Float32Array, Float32Array], epsilon: float, ended: list[int]
    ) -> int:
        """Running option of an environment in this tick."""
        running, (q, beta) = self._running[i], values
        prospect = OptionView(q[i], beta[i], told.available, told.finished, told.critical)
        if not running.executor.ends(prospect, float(self._rng.random())):
            assert running.executor.option is not None
            return running.executor.option
        if running.executor.option is not None:
            self._keep(running, told, False, ended)
        return running.executor.begin(prospect, epsilon, self._rng)

    def _keep(self, running: OptionRollout, after: MasterView, terminated: bool, ended: list[int]) -> None:
        """Puts the transitions of a finished option into the replay."""
        executor = running.executor
        assert executor.option is not None
        if samples := list(running.samples(self._config.gamma)):
            states, totals, ticks = zip(*samples, strict=True)
            count = len(samples)
            rows = {
                "state": torch.from_numpy(np.stack(states)),
                "option": torch.full((count,), executor.option),
                "total": torch.tensor(totals, dtype=torch.float32),
                "ticks": torch.tensor(ticks, dtype=torch.float32),
                "after": torch.from_numpy(after.state).expand(count, -1),
                "available": torch.from_numpy(after.available).expand(count, -1),
                "terminated": torch.full((count,), terminated),
            }
            self._replay.add(TensorDict(rows, [count]))
        ended.append(executor.ticks)
        _forget(running)

    def _explored(self, option: int, state: Float32Array) -> Tensor:
        """(2,) action of an option's policy: sampled if the option learns, else its mean."""
        name = OPTIONS[option]
        with torch.no_grad():
            seen = self.actor.view(name, torch.from_numpy(state).to(self._device)[None])
            mean, std = self.actor.actor(name).gaussian(seen)
            return (torch.normal(mean, std) if self._config.intra_option_learning_rate else mean)[0].cpu()

    def _answer(self, vectors: Array) -> Float32Array:
        with torch.no_grad():
            answer: Float32Array = self.actor(torch.from_numpy(vectors).to(self._device)).cpu().numpy()
        return answer

    def _values(self, states: Float32Array) -> tuple[Float32Array, Float32Array]:
        """Q and beta, (N, options) each, without the options' actions, which would take most of the time."""
        with torch.no_grad():
            q, beta = self.actor.values(torch.from_numpy(states).to(self._device))
        return q.cpu().numpy(), beta.cpu().numpy()

    def _learn_values(self) -> dict[str, Number]:
        """SMDP Q-learning; the network chooses the best option, the target network gives its value."""
        config, losses, q = self._config, list[float](), torch.zeros(1)
        if len(self._replay) < config.batch:
            return {}
        for _ in range(config.updates):
            batch = self._replay.sample(config.batch).to(self._device)
            q = self.actor.values.values(batch["state"])
            with torch.no_grad():
                after = batch["after"]
                mine = self.actor.values.values(after).masked_fill(~batch["available"], -np.inf)
                best = self._target.values(after).gather(1, mine.argmax(dim=1, keepdim=True))[:, 0]
                wanted = smdp_target(batch["total"], batch["ticks"], best, batch["terminated"], config.gamma)
            chosen = q.gather(1, batch["option"][:, None])[:, 0]
            losses.append(self._step("q", torch.nn.functional.smooth_l1_loss(chosen, wanted, beta=0.1)))
            with torch.no_grad():
                for slow, fast in zip(self._target.parameters(), self.actor.values.parameters(), strict=True):
                    slow.lerp_(fast, config.target_share)
            self.updates += 1
        return {"loss_q": _mean(losses), "q": q.detach().mean().item()}

    def _learn_ticks(self, ticks: _Ticks) -> dict[str, Number]:
        """The gradients of terminations and of the options' own policies, on this round's ticks."""
        if not ticks.options:
            return {}
        config = self._config
        before, after = (torch.from_numpy(np.stack(rows)).to(self._device) for rows in (ticks.before, ticks.after))
        options = torch.tensor(ticks.options, device=self._device)
        rewards = torch.tensor(ticks.rewards, dtype=torch.float32, device=self._device)
        ended = torch.tensor(ticks.terminated, device=self._device)
        available = torch.from_numpy(np.stack(ticks.available)).to(self._device)
        q_after, betas = self.actor.values(after)
        column = options[:, None]
        beta, q_option = betas.gather(1, column)[:, 0].detach(), q_after.gather(1, column)[:, 0].detach()
        best = best_value(q_after, available).detach()
        going = ~ended
        row: dict[str, Number] = {"beta": float(beta.mean())}
        if bool(going.any()):
            row["loss_beta"] = self._learn_endings(after[going], column[going], q_option[going], best[going])
        if config.intra_option_learning_rate:
            with torch.no_grad():
                arrived = rewards + config.gamma * torch.where(ended, 0.0, arrival_value(q_option, beta, best))
                baseline = self.actor.values.values(before).gather(1, column)[:, 0]
            self._step("options", intra_option_loss(self._log_prob(before, options, ticks.units), arrived, baseline))
        return row

    def _learn_endings(self, after: Tensor, column: Tensor, q_option: Tensor, best: Tensor) -> float:
        """Gradient of terminations where options could continue; with too few steps, options last too long."""
        losses = []
        for _ in range(self._config.termination_updates):
            beta = torch.sigmoid(self.actor.values.endings(after)).gather(1, column)[:, 0]
            loss = termination_loss(beta, q_option, best, self._config.deliberation_cost)
            losses.append(self._step("beta", loss))
        return sum(losses) / len(losses)

    def _log_prob(self, states: Tensor, options: Tensor, units: list[Tensor]) -> Tensor:
        """(N,) log-probability of the actions under their options' policies, up to a constant."""
        taken, out = torch.stack(units).to(self._device), torch.zeros(len(units), device=self._device)
        for i, name in enumerate(OPTIONS):
            rows = options == i
            if bool(rows.any()):
                mean, std = self.actor.actor(name).gaussian(self.actor.view(name, states[rows]))
                z = (taken[rows] - mean) / std
                out = out.masked_scatter(rows, (-0.5 * z * z - std.log()).sum(dim=1))
        return out

    def _step(self, name: str, loss: Tensor) -> float:
        optimizer = self._optimizers[name]
        optimizer.zero_grad(set_to_none=True)
        loss.backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(optimizer.param_groups[0]["params"], 1.0)
        optimizer.step()
        return float(loss.detach())

    def state(self) -> dict[str, Any]:
        """State for a checkpoint."""
        return {
            "master": self.actor.state_dict(),
            "target": self._target.state_dict(),
            "optimizers": {name: optimizer.state_dict() for name, optimizer in self._optimizers.items()},
            "replay": self._replay.state(),
            "choices": generator_state(self._rng),
            "updates": self.updates,
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restores a state."""
        self.actor.load_state_dict(state["master"])
        self._target.load_state_dict(state["target"])
        for name, optimizer in self._optimizers.items():
            optimizer.load_state_dict(state["optimizers"][name])
        self._replay.restore(state["replay"])
        self._rng, self.updates = generator_of(state["choices"]), state["updates"]


def train_master(config: MasterConfig, request: TrainRequest) -> Path:
    """Trains the master of a folder of sub-policies."""
    policies = read_sub_policies(config.options)
    task = MissionTask(policies.state, policies.steering, config.form, config.rules_when_critical, config.held_out)

    def learner(collector: Collector, run: TaskRun) -> OptionCritic:
        master = master_of(policies, config.option_critic.hidden, config.option_critic.tempo)
        return OptionCritic(master, collector, config.option_critic, config.seed, run.device)

    return train_task(learner, task, config, request)


def _forget(running: OptionRollout) -> None:
    """Ends the running option and drops its ticks."""
    running.executor.reset()
    running.clear()


def _mean(values: list[float] | list[int]) -> float | None:
    return sum(values) / len(values) if values else None


MASTER = Trainer("GHRL's master: chooses among the sub-policies, by option-critic", MasterConfig, train_master)
