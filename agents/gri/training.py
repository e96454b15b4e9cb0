"""Trainer `gri`: an off-policy algorithm with demonstrations in its replay, on driving or any gymnasium environment.

    dohyo train gymnasium --set env=Pendulum-v1 --set steps=5000 --out out/expert
    dohyo train gri --set env=Pendulum-v1 --set algorithm=ddpg --set expert=out/expert/best.onnx --set gri.p_demo=0.2

    dohyo train gri --config agents/gri/configs/griad.toml --out out/griad

With `gri.p_demo=0` it is the algorithm alone.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Final, Literal

from pydantic import Field

from dohyo.agents.gri.demonstrated_replay import DemonstratedReplay, GriConfig, room_for_demonstrations
from dohyo.agents.gri.driving.task import ENCODERS, DrivingTask
from dohyo.agents.gri.experts import DemonstratedTask, expert_policy
from dohyo.agents.learning.algorithms.ddpg import DdpgConfig
from dohyo.agents.learning.algorithms.iqn import IqnConfig
from dohyo.agents.learning.algorithms.off_policy import make_replay
from dohyo.agents.learning.algorithms.sac import SacConfig
from dohyo.agents.learning.experience.collector import Collector
from dohyo.agents.learning.experience.demonstrations import INDEX, Demonstrations, record_demonstrations
from dohyo.agents.learning.experience.explorers import Explorers
from dohyo.agents.learning.gymnasium.task import OFF_POLICY, GymnasiumTask
from dohyo.agents.learning.runs.config import Positive
from dohyo.agents.learning.runs.off_policy_config import OffPolicyRunConfig
from dohyo.agents.learning.runs.run import TaskRun
from dohyo.agents.learning.runs.trainer import Trainer, TrainRequest
from dohyo.agents.learning.runs.training import Learner, train_off_policy
from dohyo.agents.learning.tasks.task import Task, check_task
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.seeds import HELD_OUT_FROM

DRIVING: Final = {task.name: task for sees in ENCODERS for task in (DrivingTask(sees), DrivingTask(sees, varied=True))}
"""Driving tasks by the name of their environment."""
RECORDED_WITH: Final = 1_000_000
"""Seed of the recordings: all trainings of a study learn from the same demonstrations."""


class GriRunConfig(OffPolicyRunConfig):
    """A training with GRI.

    Attributes:
        env: "driving-" and what is seen ("state", "pictures", "affordances", or "classification" and "untrained" of
            encoders that learned less), in town by GRIAD's choices and reward; with "-varied" in NoCrash's four
            conditions of training, otherwise in clear ones. Or a name in gymnasium's registry, or "module:NAME" of one
            that the module registers.
        algorithm: What learns; its settings are the table of that name.
        episodes: Held-out episodes.
        expert: ONNX file of the policy that demonstrates; empty: the task's own expert.
        demonstrations: Folder of recorded demonstrations; empty: they are recorded into the run's folder.
        shown: Demonstrations to be recorded.
        gri: Settings of GRI.
        sac: Settings of SAC.
        ddpg: Settings of DDPG.
        iqn: Settings of IQN.
    """

    env: str = "Pendulum-v1"
    algorithm: Literal["sac", "ddpg", "iqn"] = "sac"
    processes: Annotated[int, Field(ge=0, le=64)] = 0
    episodes: Positive = 20
    expert: str = ""
    demonstrations: str = ""
    shown: Positive = 20
    gri: GriConfig = GriConfig()
    sac: SacConfig = SacConfig()
    ddpg: DdpgConfig = DdpgConfig()
    iqn: IqnConfig = IqnConfig()

    @property
    def task(self) -> Task:
        """What is learned."""
        return task_of(self.env, HELD_OUT_FROM, self.episodes)


def task_of(env: str, first: int, episodes: int) -> Task:
    """Task of an environment.

    Args:
        env: See `GriRunConfig`.
        first: Seed of the first held-out episode.
        episodes: Number of held-out episodes.
    """
    driving = DRIVING.get(env)
    if driving is None:
        return GymnasiumTask(env, episodes, first)
    return replace(driving, episodes=episodes, first=first)


def make_learner(settings: GriRunConfig, task: Task, collector: Collector | Explorers, run: TaskRun) -> Learner:
    """Learner of the algorithm that the settings name, with demonstrations in its replay if there are any.

    Raises:
        InvalidInputError: Explored steps have a constant reward that says nothing; see `demonstrations_of` for more.
    """
    kind, config, gri = OFF_POLICY[settings.algorithm], getattr(settings, settings.algorithm), settings.gri
    if gri.p_demo == 0.0:
        if gri.explorer_reward is not None:
            raise InvalidInputError("gri.explorer_reward: expected gri.p_demo above 0; it stands beside demonstrations")
        replay = make_replay(task, run, config, rows=len(collector))
    else:
        shown = demonstrations_of(settings, task, run.folder)
        replay = make_replay(
            task, run, config, rows=len(collector), kind=DemonstratedReplay, shown=shown, gri=gri,
            room_for_others=lambda steps: room_for_demonstrations(gri, shown, steps),
        )  # fmt: skip
    return kind(task, collector, replay, config, run.device)


def demonstrations_of(settings: GriRunConfig, task: Task, folder: Path) -> Demonstrations:
    """Demonstrations that the settings name, or those of a run's folder, which are recorded where there are none.

    Raises:
        InvalidInputError: The settings name demonstrations that do not exist, are of another task or older, or do not
            fit the task's spaces; or the run's folder has those of another expert, left by a training that has not
            begun.
    """
    own = folder / "demonstrations"
    if not settings.demonstrations and not (own / INDEX).exists():
        record(settings, task, own)
    where = Path(settings.demonstrations or own)
    shown = Demonstrations(where)
    if shown.index.task != task.name:
        raise InvalidInputError(f"'{where}': expected demonstrations of '{task.name}', got '{shown.index.task}'")
    if isinstance(task, DrivingTask) and any(one.success and one.terminated for one in shown.index.episodes):
        raise InvalidInputError(f"'{where}': recorded when a goal was a terminal state; remove it and record anew")
    told = shown.index.expert, len(shown)
    if not settings.demonstrations and told != (wanted := (_expert(settings), settings.shown)):
        raise InvalidInputError(f"'{where}': expected expert and number of demonstrations {wanted}, got {told}")
    shown.check(task)
    return shown


def record(settings: GriRunConfig, task: Task, folder: Path) -> None:
    """Records the expert of the settings into a folder."""
    shown = DemonstratedTask(task, Path(settings.expert) if settings.expert else None, settings.gri.demo_noise)
    record_demonstrations(shown, folder, settings.shown, expert=_expert(settings), seed=RECORDED_WITH)


def _expert(settings: GriRunConfig) -> str:
    """The expert of recorded demonstrations, in a few words."""
    said, noise = str(Path(settings.expert)) if settings.expert else "the task's own", settings.gri.demo_noise
    return said if not noise else f"{said}, {100 * noise:g} % of episodes with random actions"


def _train(settings: GriRunConfig, request: TrainRequest) -> Path:
    task = settings.task
    check_task(task)
    OFF_POLICY[settings.algorithm].check(task)
    if settings.gri.p_demo and not (settings.expert or settings.demonstrations or task.has_expert):
        raise InvalidInputError(f"task '{task.name}' has no expert: expected 'expert', 'demonstrations' or p_demo = 0")
    if settings.gri.p_demo and settings.expert and not settings.demonstrations:
        expert_policy(Path(settings.expert), task)  # before anything is written
    return train_off_policy(partial(make_learner, settings, task), task, settings, request)


GRI = Trainer("driving, or any gymnasium environment, with demonstrations (GRI)", GriRunConfig, _train)
