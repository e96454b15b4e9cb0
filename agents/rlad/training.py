"""Training of RLAD, of its variants, and of its rivals: one task, one loop, one encoder's size.

    dohyo train rlad --config agents/rlad/configs/rlad.toml --out out/rlad/rlad/seed-0
    dohyo train rlad --config agents/rlad/configs/rlad.toml --set algorithm=drq --set latent.waypoints=plain \
        --set latent.local_mixing=false

Which loss moves what: the critics' loss moves the whole encoder, the actor's loss moves no encoder, the light's loss
moves the picture's encoder. There is a single encoder: none follows it, targets are of the learned one.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from dohyo.agents.endless_driving.config import TownConfig
from dohyo.agents.endless_driving.latent import Latent, LatentConfig
from dohyo.agents.endless_driving.observation import PICTURE
from dohyo.agents.endless_driving.task import EndlessDriving
from dohyo.agents.learning.algorithms.off_policy import Augment, make_replay
from dohyo.agents.learning.algorithms.sac import Auxiliary, Sac, SacConfig
from dohyo.agents.learning.experience.collector import Collector
from dohyo.agents.learning.experience.explorers import Explorers
from dohyo.agents.learning.experience.replay import ReplayConfig
from dohyo.agents.learning.runs.config import Positive, Share
from dohyo.agents.learning.runs.off_policy_config import OffPolicyRunConfig
from dohyo.agents.learning.runs.run import TaskRun
from dohyo.agents.learning.runs.trainer import Trainer, TrainRequest
from dohyo.agents.learning.runs.training import Learner, train_off_policy
from dohyo.agents.perception.augmentation import of_transitions, random_shift
from dohyo.agents.rlad.light_loss import LightLoss
from dohyo.agents.rlad.rivals.curl import Contrast, two_views
from dohyo.agents.rlad.rivals.drq import Drq
from dohyo.agents.rlad.rivals.drq_v2 import DrqV2, DrqV2Config
from dohyo.agents.rlad.rivals.sac_ae import Reconstruction
from dohyo.sumo_networks.errors import InvalidInputError

Algorithm = Literal["rlad", "sac-ae", "curl", "drq", "drq-v2"]


class RladConfig(SacConfig):
    """Settings of SAC as in table 3.2, but for the batch (256) and the width of the layers (1024)."""

    replay: ReplayConfig = ReplayConfig(capacity=100_000)
    batch: Positive = 64
    learning_rate: Annotated[float, Field(gt=0)] = 1e-3
    tau: Share = 0.01
    initial_alpha: Annotated[float, Field(gt=0)] = 0.1
    learning_starts: Annotated[int, Field(ge=0)] = 1000


class RladRunConfig(OffPolicyRunConfig):
    """A training of RLAD or of a rival.

    Attributes:
        algorithm: What learns.
        town: Settings of the task.
        latent: Settings of the encoders.
        shifts: Whether RLAD's pictures are shifted at random; rivals shift as their sources say.
        light_loss: Whether RLAD has the loss of traffic lights.
        sac: Settings of RLAD and of the rivals on SAC.
        drq_v2: Settings of DrQ-v2.
    """

    algorithm: Algorithm = "rlad"
    town: TownConfig = TownConfig()
    latent: LatentConfig = LatentConfig()
    shifts: bool = True
    light_loss: bool = True
    sac: RladConfig = RladConfig()
    drq_v2: DrqV2Config = DrqV2Config()

    @property
    def task(self) -> EndlessDriving:
        """What is learned."""
        return EndlessDriving(self.town)


def make_learner(settings: RladRunConfig, collector: Collector | Explorers, run: TaskRun) -> Learner:
    """The learner that the settings name."""
    task, town = settings.task, settings.town
    config: Any = settings.drq_v2 if settings.algorithm == "drq-v2" else settings.sac
    frames = town.frames if town.view == "picture" else 1
    replay = make_replay(task, run, config, rows=len(collector), stack=frames)
    latent = Latent(task.observation_space, settings.latent)
    shift = of_transitions(partial(random_shift, pad=town.shift_px), [PICTURE])
    given: dict[str, Any] = {"encoder": latent, "augment": _augment(settings, shift)}
    kind: Any = {"drq": Drq, "drq-v2": DrqV2}.get(settings.algorithm, Sac)
    if auxiliary := _auxiliary(settings, latent):
        given["auxiliary"] = [one.to(run.device) for one in auxiliary]
    made: Learner = kind(task, collector, replay, config, run.device, **given)
    return made


def _augment(settings: RladRunConfig, shift: Augment) -> Augment | None:
    """Change of a batch; SAC+AE has none, and RLAD none where there are no pictures."""
    if settings.town.view == "state" or settings.algorithm == "sac-ae":
        return None
    if settings.algorithm == "curl":
        return two_views(shift)
    return shift if settings.algorithm != "rlad" or settings.shifts else None


def _auxiliary(settings: RladRunConfig, latent: Latent) -> list[Auxiliary]:
    """Losses beside those of SAC."""
    if settings.algorithm == "rlad" and settings.light_loss:
        return [LightLoss(latent)]
    if settings.algorithm == "sac-ae":
        return [Reconstruction(latent)]
    return [Contrast(latent)] if settings.algorithm == "curl" else []


def _train(settings: RladRunConfig, request: TrainRequest) -> Path:
    if settings.algorithm != "rlad" and settings.town.view == "state":
        raise InvalidInputError(f"'{settings.algorithm}' learns from pictures: expected town.view = 'picture'")
    return train_off_policy(partial(make_learner, settings), settings.task, settings, request)


RLAD = Trainer(
    "target speed and steering from pictures, by RLAD or by SAC+AE, CURL, DrQ, DrQ-v2", RladRunConfig, _train
)
