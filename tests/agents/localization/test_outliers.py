"""The outlier policies on a car at rest: which fixes count as used, and what a wild first fix changes."""

from __future__ import annotations

import numpy as np
import pytest

from dohyo.agents.localization.filters.base import FilterNoise, InitialState
from dohyo.agents.localization.filters.es_ekf import EsEkf
from dohyo.agents.localization.filters.measurements import AntennaPosition
from dohyo.agents.localization.outliers import PATIENCE, Corrector, Gate, Robust
from dohyo.sumo_networks.ego.dynamics import GRAVITY


def at_rest() -> EsEkf:
    return EsEkf(InitialState(np.zeros(3), np.zeros(3), 0.0, 2.0, 0.1, 0.1), FilterNoise(accelerometer=0.3))


def fixed(corrector: Corrector, time: float, east_m: float) -> None:
    corrector.fix(AntennaPosition.of(np.array([east_m, 0.0, 0.0]), 2.0), time)


def stood(corrector: Corrector, seconds: float) -> None:
    for _ in range(round(seconds / 0.5)):
        corrector.predict(np.array([0.0, 0.0, GRAVITY]), np.zeros(3), 0.5)


def test_the_gate_says_that_it_used_the_fix_that_it_believed() -> None:
    gate = Gate(at_rest())
    for second in range(PATIENCE):
        fixed(gate, float(second), 100.0)
    assert gate.filter.position[0] == pytest.approx(100.0, abs=1.0)
    assert [fix.used for fix in gate.judged] == [False] * (PATIENCE - 1) + [True]
    assert gate.judged[-1].innovation.residual[0] == pytest.approx(100.0), "as surprising as it was"


@pytest.mark.parametrize("first_m", [0.0, 100.0])
def test_a_fix_after_a_silence_is_doubted_also_where_the_first_fix_was_wild(first_m: float) -> None:
    robust = Robust(at_rest())
    for second, silence, east in ((0.0, 1.0, first_m), (1.0, 29.0, 0.0), (30.0, 1.0, 20.0), (31.0, 0.0, 0.0)):
        fixed(robust, second, east)
        stood(robust, silence)
    assert robust.filter.position[0] == pytest.approx(0.0, abs=1.0)
    assert [fix.used for fix in robust.judged] == [first_m == 0.0, True, False, True]
