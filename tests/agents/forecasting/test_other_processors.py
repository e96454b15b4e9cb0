"""Forecasts do not depend on the processor's kernels, so that a record's hash verifies on another machine."""

from __future__ import annotations

from tests.agents.old_processor import printed_here_and_there

PROGRAM = """
import hashlib
import numpy as np
from dohyo.agents.forecasting.registry import load_forecaster
histories = np.random.default_rng(0).uniform(5.0, 30.0, (200, 8, 21))
for name in ("linear", "tsmixer", "sa-lstm", "sa-lstm-n-step", "sa-lstm-quantiles"):
    forecaster = load_forecaster(name)
    ahead = np.stack([forecaster.predict(one) for one in histories])
    print(name, hashlib.sha256(ahead.tobytes()).hexdigest())
"""


def test_forecasts_are_the_same_with_the_kernels_of_an_old_processor() -> None:
    here, old = printed_here_and_there(PROGRAM)
    assert len(here) == 5
    assert here == old
