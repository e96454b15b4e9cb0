"""Forecasts do not depend on the processor's kernels, so that a record's hash verifies on another machine."""

from __future__ import annotations

import os
import subprocess
import sys

OLD_PROCESSOR = {
    "ATEN_CPU_CAPABILITY": "default",
    "MKL_CBWR": "COMPATIBLE",
    "ONEDNN_MAX_CPU_ISA": "SSE41",
    "OPENBLAS_CORETYPE": "Nehalem",
}
"""Makes the libraries of linear algebra take kernels without AVX."""

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
    environment = {name: value for name, value in os.environ.items() if name not in OLD_PROCESSOR}
    here, old = (
        subprocess.run(
            [sys.executable, "-c", PROGRAM], env=some, capture_output=True, text=True, check=True
        ).stdout.splitlines()
        for some in (environment, environment | OLD_PROCESSOR)
    )
    assert len(here) == 5
    assert here == old
