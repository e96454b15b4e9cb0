"""The master learns whom to choose, on a chain of places whose solution is known; no simulation."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.spaces import Box
from tensordict import TensorDict

from dohyo.agents.hierarchical.master import Master, MasterSpec, MasterView, parts
from dohyo.agents.hierarchical.options.executor import OptionLimits
from dohyo.agents.hierarchical.options.manoeuvres import Manoeuvre
from dohyo.agents.hierarchical.state.master_observation import CRITICAL, FLAGS, FRESH, OPTIONS
from dohyo.agents.hierarchical.training.master_training import OptionCritic, OptionCriticConfig
from dohyo.agents.learning.experience.collector import Collector
from dohyo.agents.learning.networks.policy import Actor
from dohyo.agents.learning.tasks.task import SINGLE, Task, held_out_seeds
from dohyo.sumo_networks.errors import SimulationError

PLACES, GAMMA = 4, 0.9
LEFT, RIGHT, LIGHTS = (OPTIONS.index(one) for one in (Manoeuvre.LEFT, Manoeuvre.RIGHT, Manoeuvre.LIGHTS))
CONFIG = OptionCriticConfig(
    horizon=64,
    gamma=GAMMA,
    epsilon=0.5,
    epsilon_end=0.5,
    learning_rate=3e-3,
    intra_option_learning_rate=1e-4,
    updates=16,
    batch=64,
    target_share=0.05,
    hidden=(32,),
    tempo=OptionLimits(least_ticks=1, most_ticks=2),
)


@pytest.fixture(scope="module", autouse=True)
def one_thread() -> Iterator[None]:
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


class Chain(gymnasium.Env):
    """Places in a row: RIGHT goes right, LEFT left, the others stay; the right end pays 1 and ends the episode.

    Attributes:
        ruled: Place at which the rules drive, to the left; -1: none.
        fragile: Ticks after which the simulation fails in episodes that begin on the left; 0: never.
    """

    observation_space = Box(-np.inf, np.inf, (PLACES + len(OPTIONS) + FLAGS,), np.float32)

    def __init__(self, ruled: int = -1, fragile: int = 0) -> None:
        self.ruled, self.fragile = ruled, fragile

    def reset(self, *, seed=None, options=None):
        self.place, self.ticks = int(np.random.default_rng(seed).integers(PLACES - 1)), 0
        self.fails = self.place == 0 and self.fragile > 0
        return self._seen(), {}

    def step(self, action):
        if self.fails and self.ticks == self.fragile:
            raise SimulationError("the chain is torn")
        option = LEFT if self.place == self.ruled else round(float(action[2]))
        self.place = min(max(self.place + (option == RIGHT) - (option == LEFT), 0), PLACES - 1)
        self.ticks += 1
        there = self.place == PLACES - 1
        return self._seen(), float(there), there, self.ticks >= 20, {"success": there}

    def _seen(self):
        out = np.zeros(self.observation_space.shape, np.float32)
        out[self.place] = 1.0
        out[PLACES : PLACES + len(OPTIONS)] = 1.0
        out[PLACES + LIGHTS] = 0.0
        flags = out[PLACES + len(OPTIONS) :]
        flags[CRITICAL], flags[FRESH] = self.place == self.ruled, self.ticks == 0
        return out


@dataclass(frozen=True)
class ChainTask(Task):
    ruled: int = -1
    fragile: int = 0

    name = "chain"
    observation_space = Chain.observation_space
    action_space = Box(np.array([-1, -1, 0], np.float32), np.array([1, 1, len(OPTIONS) - 1], np.float32))

    @property
    def held_out(self) -> Sequence[int]:
        return held_out_seeds(3)

    def make_env(self, rank):
        return Chain(self.ruled, self.fragile)


def learner(
    task: ChainTask = ChainTask(), count: int = 2, config: OptionCriticConfig = CONFIG, begin_after: int = 0
) -> tuple[OptionCritic, Collector]:
    torch.manual_seed(0)
    actors = {name: Actor(PLACES, -torch.ones(2), torch.ones(2), (4,)) for name in OPTIONS}
    rows = {name: torch.arange(PLACES) for name in OPTIONS}
    master = Master(PLACES, config.hidden, actors, rows, MasterSpec(tempo=config.tempo))
    collector = Collector(task.make_environments(count, processes=False), task, 0, begin_after)
    return OptionCritic(master, collector, config, 0, torch.device("cpu")), collector


def values(found: OptionCritic) -> np.ndarray:
    """(places, options) Q, in rewards."""
    with torch.no_grad():
        q, _ = found.actor.values(torch.eye(PLACES))
    return q.numpy() / (1.0 - GAMMA)


def acted(found: OptionCritic, vector: np.ndarray) -> np.ndarray:
    """Action for one observation."""
    return found.act(TensorDict({SINGLE: torch.from_numpy(vector)[None]}, [1]))[0]


@pytest.fixture(scope="module")
def trained() -> OptionCritic:
    found, _ = learner()
    found.begin()
    for _ in range(30):
        found.round()
    return found


def test_it_learns_the_value_of_the_way_to_the_goal(trained):
    q = values(trained)
    assert q[:3, RIGHT] == pytest.approx([GAMMA**2, GAMMA, 1.0], abs=0.12)
    for place in range(3):
        others = [q[place, option] for option in range(len(OPTIONS)) if option not in (RIGHT, LIGHTS)]
        assert q[place, RIGHT] > max(others) + 0.03


def test_it_takes_the_shortest_way_without_exploration(trained):
    env = Chain()
    for seed in held_out_seeds(5):
        seen, _ = env.reset(seed=seed)
        shortest, ended = PLACES - 1 - env.place, False
        while not ended:
            seen, _, ended, late, _ = env.step(acted(trained, seen))
            assert not late
        assert env.ticks == shortest


def test_what_may_not_begin_is_never_chosen():
    found, collector = learner()
    found.begin()
    taken = []
    step = collector.step
    collector.step = lambda behaviour: _noted(step(behaviour), taken)
    for _ in range(3):
        row = found.round()
    assert LIGHTS not in taken
    assert len(set(taken)) == len(OPTIONS) - 1
    assert row["share_lights"] == 0.0


def _noted(step, taken):
    taken.extend(step["action"][:, 2].tolist())
    return step


def test_what_the_rules_do_counts_to_the_option_that_led_there():
    # The rules lead back from place 1, so the goal is only reached from place 2.
    found, _ = learner(ChainTask(ruled=1))
    found.begin()
    for _ in range(20):
        row = found.round()
    assert 0.01 < row["critical_share"] < 0.6
    q = values(found)
    assert q[2, RIGHT] == pytest.approx(1.0, abs=0.12)
    assert q[0, RIGHT] == pytest.approx(0.0, abs=0.1)


def test_without_intra_option_learning_the_policies_stay_and_with_it_they_change():
    for rate, changes in ((0.0, False), (1e-3, True)):
        found, _ = learner(config=CONFIG.model_copy(update={"intra_option_learning_rate": rate}))
        before = [parameter.clone() for parameter in found.actor.actors.parameters()]
        found.begin()
        found.round()
        after = list(found.actor.actors.parameters())
        assert any(not torch.equal(a, b) for a, b in zip(before, after, strict=True)) is changes


def test_it_goes_on_from_its_state_to_the_bit():
    one, collector = learner()
    one.begin()
    for _ in range(3):
        collector.cut_at = 3 * 2 * CONFIG.horizon
        one.round()
    assert collector.cut
    collector.cut_at = 0
    kept, seen, random = copy.deepcopy((one.state(), collector.state(), torch.get_rng_state()))
    expected = [one.round() for _ in range(3)]
    other, again = learner()
    again.restore(seen)
    other.restore(kept)
    torch.set_rng_state(random)
    assert [other.round() for _ in range(3)] == expected


def test_rows_that_sit_out_choose_nothing_and_learn_nothing(monkeypatch):
    """Before its first episode a row sees zeros, where no option may begin."""
    found, collector = learner(begin_after=3)
    steps, learned = list[TensorDict](), list[TensorDict]()
    step, add = collector.step, found._replay.add
    monkeypatch.setattr(collector, "step", lambda behaviour: _kept(step(behaviour), steps))
    monkeypatch.setattr(found._replay, "add", lambda rows: add(_kept(rows, learned)))
    found.begin()
    for _ in range(3):
        row = found.round()
        assert sum(row[f"share_{option}"] for option in OPTIONS) == pytest.approx(1.0)
    active, action = (torch.stack([one[name] for one in steps]) for name in ("active", "action"))
    assert 0.2 < active.float().mean() < 0.9
    assert (action[~active] == 0.0).all()
    assert (torch.cat(learned)["state"].sum(dim=1) == 1.0).all()
    assert max(rows["ticks"].max() for rows in learned) <= CONFIG.tempo.most_ticks


def _kept(one, notes):
    notes.append(one.clone())
    return one


def test_it_learns_the_way_also_where_rows_sit_out():
    found, _ = learner(begin_after=2)
    found.begin()
    for _ in range(40):
        found.round()
    assert values(found)[:3, RIGHT] == pytest.approx([GAMMA**2, GAMMA, 1.0], abs=0.15)


def test_nothing_is_learned_of_an_option_whose_simulation_is_lost(monkeypatch):
    found, collector = learner(ChainTask(fragile=1))
    step, keep, lost = collector.step, found._keep, set[int]()

    def stepped(behaviour):
        taken = step(behaviour)
        lost.clear()
        lost.update(torch.nonzero(~taken["active"]).flatten().tolist())
        return taken

    def kept(running, *given):
        assert not any(found._running[row] is running for row in lost)
        keep(running, *given)

    monkeypatch.setattr(collector, "step", stepped)
    monkeypatch.setattr(found, "_keep", kept)
    found.begin()
    row = found.round()
    assert collector.lost_count > 3
    assert row["replay"] > 10
    assert sum(row[f"share_{option}"] for option in OPTIONS) == pytest.approx(1.0)


def test_epsilon_falls_and_stays():
    config = OptionCriticConfig(epsilon=0.5, epsilon_end=0.1, epsilon_steps=1000)
    assert [config.epsilon_at(step) for step in (0, 500, 1000, 9000)] == pytest.approx([0.5, 0.3, 0.1, 0.1])


def test_an_answer_is_taken_apart_as_it_was_put_together():
    found, _ = learner()
    seen, _ = Chain(ruled=0).reset(seed=0)
    with torch.no_grad():
        answer = found.actor(torch.from_numpy(seen)[None])
    q, beta, actions = parts(answer[0].numpy())
    assert (q.shape, beta.shape, actions.shape) == ((5,), (5,), (5, 2))
    state = torch.from_numpy(seen[:PLACES])[None]
    with torch.no_grad():
        assert actions[RIGHT] == pytest.approx(found.actor.actor(Manoeuvre.RIGHT)(state)[0].numpy())
    told = MasterView(seen, PLACES)
    assert told.fresh
    assert told.available.tolist() == [option != LIGHTS for option in range(len(OPTIONS))]
