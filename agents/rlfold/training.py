"""Training of RLfOLD, and of its variants.

dohyo train rlfold --config agents/rlfold/configs/rlfold.toml --out out/rlfold/full/seed-0
dohyo train rlfold --config agents/rlfold/configs/twin.toml --set rlfold.gate=never     # without pixels
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

from torch import Generator, Tensor

from dohyo.agents.endless_driving.config import ExpertConfig, TownConfig
from dohyo.agents.endless_driving.experts import check_expert
from dohyo.agents.endless_driving.latent import Latent, LatentConfig
from dohyo.agents.endless_driving.observation import PICTURE
from dohyo.agents.endless_driving.task import EndlessDriving
from dohyo.agents.learning.algorithms.off_policy import Augment, make_replay
from dohyo.agents.learning.experience.collector import Collector
from dohyo.agents.learning.experience.explorers import Explorers
from dohyo.agents.learning.runs.off_policy_config import OffPolicyRunConfig
from dohyo.agents.learning.runs.run import TaskRun
from dohyo.agents.learning.runs.trainer import Trainer, TrainRequest
from dohyo.agents.learning.runs.training import Learner, train_off_policy
from dohyo.agents.perception.augmentation import colour_jitter, gaussian_blur, of_transitions, random_shift
from dohyo.agents.rlfold.rlfold import EXTRAS, Rlfold, RlfoldConfig

TOWN = TownConfig(max_speed=5.0, frames=2, history=1, obey_lights=False)
"""Two frames as in section 4.3.1; 5 m/s, the last speed and steering, and no lights as in the author's release."""


class RlfoldRunConfig(OffPolicyRunConfig):
    """A training of RLfOLD.

    Attributes:
        town: Settings of the task.
        expert: Who is imitated, and drives where the gate says so.
        latent: Settings of the encoders.
        augmentation: Whether pictures are shifted, blurred, and changed in colour.
        rlfold: Settings of the learner.
    """

    town: TownConfig = TOWN
    expert: ExpertConfig = ExpertConfig()
    latent: LatentConfig = LatentConfig()
    augmentation: bool = True
    rlfold: RlfoldConfig = RlfoldConfig()

    @property
    def task(self) -> EndlessDriving:
        """What is learned; nobody is asked where nothing is imitated."""
        asked = self.rlfold.imitation != "none" or self.rlfold.gate != "never"
        return EndlessDriving(self.town, self.expert if asked else None)


def make_learner(settings: RlfoldRunConfig, collector: Collector | Explorers, run: TaskRun) -> Learner:
    """The learner of a run."""
    task, config = settings.task, settings.rlfold
    extras = EXTRAS if task.has_expert else {}
    frames = settings.town.frames if settings.town.view == "picture" else 1
    replay = make_replay(task, run, config, rows=len(collector), stack=frames, extras=extras)
    encoder, augment = Latent(task.observation_space, settings.latent), augmentation(settings)
    return Rlfold(task, collector, replay, config, run.device, encoder=encoder, augment=augment)


def augmentation(settings: RlfoldRunConfig) -> Augment | None:
    """Changes of the pictures of a batch; None without pictures."""
    if settings.town.view == "state" or not settings.augmentation:
        return None
    return of_transitions(partial(_changed, pad=settings.town.shift_px), [PICTURE])


def _changed(pictures: Tensor, generator: Generator, pad: int) -> Tensor:
    shifted = random_shift(pictures, generator, pad=pad)
    blurred = gaussian_blur(shifted, generator, sigma=(0.1, 1.0))
    return colour_jitter(blurred, generator, brightness=0.2, contrast=0.2, saturation=0.2)


def _train(settings: RlfoldRunConfig, request: TrainRequest) -> Path:
    check_expert(settings.expert.name)  # environments in processes begin later
    return train_off_policy(partial(make_learner, settings), settings.task, settings, request)


RLFOLD = Trainer("target speed and steering by RLfOLD: SAC, an expert's labels, and a gate", RlfoldRunConfig, _train)
