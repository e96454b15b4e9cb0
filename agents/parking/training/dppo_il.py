"""Training of parking: PPO, SAC, MA-POCA, and the parts of DPPO-IL on PPO (Albilani 2023, algorithm 9).

    dohyo train parking --config agents/parking/configs/parking.toml --out out/parking/dppo-il/seed-0

DPPO-IL has two phases. First the policy imitates demonstrations by BCO: an inverse dynamics model learns which action
leads from one observation to the next, by default from the demonstrations and their actions. Then PPO maximises the
task's reward, the surprise of a forward model (ICM) and the success in passing as the expert (GAIL).

Where the thesis has no number, the default is that of Unity ML-Agents, with which it was made; others are marked.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field
from tensordict import TensorDict
from torch import nn
from torchrl.modules import MLP

from dohyo.agents.learning.algorithms.icm import Icm, IcmConfig
from dohyo.agents.learning.algorithms.intrinsic import IntrinsicReward
from dohyo.agents.learning.algorithms.off_policy import make_replay
from dohyo.agents.learning.algorithms.poca import Poca, PocaConfig
from dohyo.agents.learning.algorithms.ppo import Ppo
from dohyo.agents.learning.algorithms.sac import Sac, SacConfig
from dohyo.agents.learning.experience.collector import Collector
from dohyo.agents.learning.experience.demonstrations import INDEX, Demonstrations, record_demonstrations
from dohyo.agents.learning.imitation.bco import Bco, BcoConfig, InverseDynamicsConfig
from dohyo.agents.learning.imitation.gail import Gail, GailConfig
from dohyo.agents.learning.runs.config import Positive, RunConfig
from dohyo.agents.learning.runs.run import TaskRun
from dohyo.agents.learning.runs.trainer import Trainer, TrainRequest
from dohyo.agents.learning.runs.training import Learner, train_task
from dohyo.agents.learning.tasks.task import named
from dohyo.agents.parking.training.features import KartFeatures
from dohyo.agents.parking.training.task import ParkingTask, Reward, SceneName
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.parking.generate import DAY_TICKS

LOTS = 256
"""Agents that learn together in the thesis, after it had begun with 8."""
LIMITS_BETWEEN_CUTS = 3
"""Least number of episodes at their time limit between two checkpoints of a training with a curriculum."""
_EXPERT = "hybrid A* on Dubins curves with a tracker, forwards only"


_SHOWN: dict[SceneName, Reward] = {"simple": "simple", "complex": "aligned"}
"""Reward whose successes are demonstrated."""


class DemonstrationsConfig(Config):
    """Demonstrations of the expert; the thesis has no number of them.

    Attributes:
        episodes: Recorded episodes, all of them successful.
        seed: Of the recording.
        disturbance: See `GuidedVectorEnv`.
    """

    episodes: Positive = 500
    seed: Annotated[int, Field(ge=0)] = 1_000_000
    disturbance: Annotated[float, Field(ge=0)] = 0.3


class ParkingConfig(RunConfig):
    """A training of parking karts.

    Attributes:
        environments: Karts, of all lots together.
        scene: Kind of lot.
        karts: In each lot.
        reward: See `agents.parking.training.task.REWARDS`.
        progress: Reward per metre towards the spot (ours).
        gradual: Whether the curriculum is used; checkpoints must then be three time limits apart.
        lots: Held-out lots of an evaluation.
        algorithm: What learns.
        curiosity: Whether ICM rewards PPO or MA-POCA; refused with SAC.
        gail: Whether GAIL rewards PPO or MA-POCA; refused with SAC.
        bco: Whether PPO or MA-POCA begin by BCO; refused with SAC.
        ppo: Settings of PPO and MA-POCA.
        sac: Settings of SAC.
        icm: Settings of the curiosity.
        adversarial: Settings of GAIL; by default without the expert's actions, as BCO.
        cloning: Settings of BCO.
        demonstrations: Settings of the demonstrations.
    """

    processes: Literal[0] = 0
    environments: Positive = LOTS
    scene: SceneName = "complex"
    karts: Positive = 1
    reward: Reward = "aligned"
    progress: float = 0.05
    gradual: bool = False
    lots: Positive = 256
    algorithm: Literal["ppo", "poca", "sac"] = "ppo"
    curiosity: bool = False
    gail: bool = False
    bco: bool = False
    ppo: PocaConfig = PocaConfig(
        horizon=64, learning_rate=3e-4, learning_rate_decay=0.985, batch=1024, entropy=1e-3, gamma=0.9995,
        hidden=(128, 128), normalised=True, initial_std=0.5,
    )  # fmt: skip
    sac: SacConfig = SacConfig(learning_rate=3e-4, hidden=(128, 128), updates_per_step=0.05)
    icm: IcmConfig = IcmConfig(batch=1024, epochs=1)
    adversarial: GailConfig = GailConfig(strength=0.002, sees="next")
    cloning: BcoConfig = BcoConfig(
        experience="demonstrated",
        inverse=InverseDynamicsConfig(batch=512, epochs=10),
        batch=512,
        learning_rate=1e-3,
        passes=15,
    )
    demonstrations: DemonstrationsConfig = DemonstrationsConfig()

    @property
    def task(self) -> ParkingTask:
        """What is learned."""
        return ParkingTask(self.scene, self.reward, self.progress, self.karts, self.gradual, self.lots)


def _check_parts(settings: ParkingConfig) -> None:
    """Parts of DPPO-IL are parts of PPO and MA-POCA; SAC would leave them out."""
    parts = [name for name in ("bco", "gail", "curiosity") if getattr(settings, name)]
    if settings.algorithm == "sac" and parts:
        said = ", ".join(f"{name} = true" for name in parts)
        raise InvalidInputError(
            f"expected bco, gail and curiosity = false with SAC, which has no such parts, got {said}"
        )


def _check_cuts(settings: ParkingConfig) -> None:
    """A curriculum counts whole episodes between two checkpoints; where hardly one fits, it would never promote."""
    least = LIMITS_BETWEEN_CUTS * DAY_TICKS * settings.environments
    if settings.gradual and settings.checkpoint_every < least:
        raise InvalidInputError(
            f"gradual=true: expected checkpoint_every of at least {least}, {LIMITS_BETWEEN_CUTS} time limits of "
            f"{settings.environments} karts, got {settings.checkpoint_every}"
        )


def make_learner(settings: ParkingConfig, collector: Collector, run: TaskRun) -> Learner:
    """Learner that the settings name.

    Raises:
        InvalidInputError: Checkpoints come too often for a curriculum.
    """
    _check_cuts(settings)
    task = settings.task
    if settings.algorithm == "sac":
        replay = make_replay(task, run, settings.sac, rows=len(collector))
        return Sac(task, collector, replay, settings.sac, run.device, encoder=KartFeatures())
    shown = demonstrated(settings, run.folder) if settings.gail or settings.bco else None
    spaces, features = (named(task.observation_space), task.action_space), KartFeatures()
    intrinsic: list[IntrinsicReward] = []
    if settings.curiosity:
        phi = nn.Sequential(features, MLP(features.features, settings.icm.features, num_cells=settings.icm.hidden))
        intrinsic.append(Icm(*spaces, settings.icm, run.device, phi))
    if settings.gail and shown is not None:
        intrinsic.append(Gail(shown, *spaces, settings.adversarial, run.device, features))
    cloning = None
    if settings.bco and shown is not None:
        cloning = Bco(shown, *spaces, settings.cloning, run.device, features)
    kind: Any = {"ppo": Ppo, "poca": Poca}[settings.algorithm]
    learner: Learner = kind(
        task, collector, settings.ppo, run.device, settings.seed, features, intrinsic=intrinsic, cloning=cloning
    )
    return learner


def demonstrated(settings: ParkingConfig, folder: Path) -> TensorDict:
    """Transitions of the demonstrations in a run's folder; recorded on the last level where there are none.

    Raises:
        InvalidInputError: Those in the folder do not fit the task.
    """
    folder = folder / "demonstrations"
    if not (folder / INDEX).exists():
        wanted = settings.demonstrations
        plain = replace(settings.task, gradual=False, reward=_SHOWN[settings.scene], disturbance=wanted.disturbance)
        record_demonstrations(
            plain, folder, wanted.episodes, expert=_EXPERT, seed=wanted.seed,
            environments=16 * settings.karts, successes_only=True,
        )  # fmt: skip
    shown = Demonstrations(folder)
    shown.check(settings.task)
    return shown.transitions()


def _train(settings: ParkingConfig, request: TrainRequest) -> Path:
    _check_parts(settings)
    return train_task(lambda collector, run: make_learner(settings, collector, run), settings.task, settings, request)


PARKING = Trainer("parking of karts, by PPO, SAC, MA-POCA or DPPO-IL", ParkingConfig, _train)
