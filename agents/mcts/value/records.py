"""Records: states visited by a search, and the best return to the horizon found from each."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numba import njit

from dohyo.agents.mcts.config import DT, Rules
from dohyo.agents.mcts.mbappe import Mbappe
from dohyo.agents.mcts.simulator import FAILED
from dohyo.agents.mcts.tree import NODES, Tree
from dohyo.agents.mcts.value.mlp import FEATURES, describe
from dohyo.agents.planning.motion import Body
from dohyo.agents.planning.scene import Scene
from dohyo.agents.planning.situation import Situation
from dohyo.evaluation.agent import Mission
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.scenario import Place

LEAST_VISITS = 12
"""Fewest visits of a state whose return is used."""
FIRST_S = 2.0


@dataclass(frozen=True, slots=True)
class Records:
    """R states with their returns.

    Attributes:
        features: (R, 24) see `mlp.describe`.
        returns: (R,) best return found from the state to the horizon.
    """

    features: FloatArray
    returns: FloatArray

    def __len__(self) -> int:
        return len(self.returns)

    @classmethod
    def of(cls, some: Iterable[Records]) -> Records:
        """Concatenates several."""
        listed = [cls(np.zeros((0, FEATURES)), np.zeros(0)), *some]
        return cls(np.concatenate([r.features for r in listed]), np.concatenate([r.returns for r in listed]))


def records_of(scenes: Iterable[Scene], simulations: int, predictor: str = "learned") -> Iterator[Records]:
    """Records of one search per scene, each begun without a plan.

    Args:
        scenes: Starts of the searches.
        simulations: Per search.
        predictor: Makes the forecasts.
    """
    agent = Mbappe(predictor=predictor, simulations=simulations)
    nobody = Mission(start=Place(lane=""), goal=Place(lane=""))
    for scene in scenes:
        agent.reset(nobody, 0)
        road, state, forecast = agent.look(scene)
        agent.decide(road, state, forecast)
        yield found_in(agent.tree, road, agent.car, agent.rules)


def found_in(tree: Tree, road: Situation, car: Body, rules: Rules) -> Records:
    """Records of a finished search: states from 2 s on, before the horizon, with enough visits."""
    nodes = int(tree.numbers[NODES])
    features, returns = np.zeros((nodes, FEATURES)), np.zeros(nodes)
    count = _collect(tree, road, car, rules, features, returns)
    return Records(features[:count], returns[:count])


@njit(cache=True, error_model="numpy")
def _collect(tree: Tree, road: Situation, car: Body, rules: Rules, features: FloatArray, returns: FloatArray) -> int:
    count = 0
    for node in range(1, tree.numbers[NODES]):
        time = tree.depth[node] * rules.hold_steps * DT
        inside = time + 1e-9 >= FIRST_S and tree.depth[node] < rules.depth
        if not inside or tree.visits[node] < LEAST_VISITS or tree.outcome[node] == FAILED:
            continue
        so_far, above = 0.0, node
        while above > 0:
            so_far += tree.reward[above]
            above = tree.parent[above]
        describe(road, car, rules, tree.state[node], time, features[count])
        returns[count] = tree.best[node] - so_far
        count += 1
    return count
