"""Updates of RLAD against bare SAC on the same pictures: what A-LIX, WayConv1D, shifts and the light's loss cost.

    python -m tests.performance.pixels

Both learn from the same batch of 64 stacks of 9 x 64 x 64, in turns, so that other load slows both.
"""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

import torch
from tensordict import TensorDictBase

from dohyo.agents.endless_driving.config import TownConfig
from dohyo.agents.endless_driving.latent import Latent, LatentConfig
from dohyo.agents.endless_driving.observation import PICTURE
from dohyo.agents.endless_driving.task import EndlessDriving
from dohyo.agents.learning.algorithms.sac import Sac
from dohyo.agents.learning.runs.memory import keep_freed_memory
from dohyo.agents.perception.augmentation import of_transitions, random_shift
from dohyo.agents.rlad.light_loss import LightLoss
from dohyo.agents.rlad.training import RladConfig
from tests.agents.learning.learners import learner
from tests.agents.rlad.test_rlad import batch

TURNS = 12


def measure() -> dict[str, float]:
    """Milliseconds of the median update of RLAD and of bare SAC, and the ratio of these."""
    torch.set_num_threads(1)
    keep_freed_memory()
    task, seen = EndlessDriving(TownConfig()), batch(RladConfig().batch)
    shift = of_transitions(partial(random_shift, pad=2), [PICTURE])
    with TemporaryDirectory() as folder:
        bare = _learner(task, Path(folder), LatentConfig(local_mixing=False, waypoints="plain"), light=False)
        whole = _learner(task, Path(folder), LatentConfig(), light=True)
        found: dict[str, list[float]] = {"bare": [], "rlad": []}
        for _ in range(TURNS):
            found["bare"].append(_ms(bare, seen))
            found["rlad"].append(_ms(whole, shift(seen)) + _ms_of(lambda: shift(seen)))
    medians = {name: median(times) for name, times in found.items()}
    return {**medians, "ratio": medians["rlad"] / medians["bare"]}


def _learner(task: EndlessDriving, folder: Path, config: LatentConfig, *, light: bool) -> Any:
    latent = Latent(task.observation_space, config)
    auxiliary = [LightLoss(latent)] if light else []
    return learner(Sac, RladConfig(), task, folder, encoder=latent, auxiliary=auxiliary)


def _ms(sac: Any, seen: TensorDictBase) -> float:
    return _ms_of(lambda: sac.learn(seen))


def _ms_of(call: Any) -> float:
    began = time.process_time()
    call()
    return 1e3 * (time.process_time() - began)


if __name__ == "__main__":
    print(measure())
