"""The search's kernels: none of them counts references to arrays, which took half of a search."""

from __future__ import annotations

from types import ModuleType

import numpy as np
import pytest
from numba.core.errors import NumbaError
from numba.core.registry import CPUDispatcher

from dohyo.agents.mcts import simulator, tree
from dohyo.agents.mcts.kernels import kernel
from dohyo.agents.mcts.predictors import described, idm
from dohyo.agents.mcts.value import mlp
from dohyo.agents.planning import motion


def own_kernels(module: ModuleType) -> dict[str, CPUDispatcher]:
    return {name: one for name, one in vars(module).items() if isinstance(one, CPUDispatcher)}


@pytest.mark.parametrize("module", [tree, simulator, mlp])
def test_no_kernel_of_the_search_counts_references(module: ModuleType) -> None:
    counting = {name for name, one in own_kernels(module).items() if one.targetoptions.get("_nrt", True)}
    assert own_kernels(module)
    assert not counting


def test_what_a_kernel_of_another_package_computes_stays_the_same() -> None:
    path = np.column_stack([np.arange(9.0), np.zeros(9), np.ones(9), np.zeros(9)])
    assert simulator.project(path, 0.0, 1.0, 3.3, 0.7, 3.0, 2.0) == motion.project(path, 0.0, 1.0, 3.3, 0.7, 3.0, 2.0)


def test_a_kernel_that_allocates_is_not_compiled() -> None:
    @kernel
    def allocates(count: int) -> float:
        return float(np.zeros(count).sum())

    with pytest.raises(NumbaError):
        allocates(3)


def test_the_predictor_counts_them_only_where_another_package_is_called() -> None:
    for module in (described, idm):
        counting = {name for name, one in own_kernels(module).items() if one.targetoptions.get("_nrt", True)}
        assert counting <= {"wrap", "idm_acceleration"}, "which take no arrays"
