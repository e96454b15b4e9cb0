"""Arms of the study: rows 1 to 5 of the thesis's comparisons, as settings of the trainer `gri`, and their experts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Final

from dohyo.agents.gri.driving.task import VARIED
from dohyo.agents.gri.training import GriRunConfig
from dohyo.agents.learning.files.settings import read_settings
from dohyo.agents.learning.gymnasium.task import GymnasiumConfig
from dohyo.agents.studies.arms import TRAININGS

_ALL: Final = ("device=cpu", "tensorboard=false", "tier=2")


@dataclass(frozen=True, slots=True)
class Problem:
    """What is learned, equal in all of its arms.

    Attributes:
        env: See `GriRunConfig`.
        learning: Settings of a training, for whatever algorithm.
        sizes: Settings of each algorithm, without its name.
        expert: Settings of the expert's training by SAC; None: the task has its own.
        shown: Number of demonstrations.
        trainings: Their seeds, of each arm.
    """

    env: str
    learning: tuple[str, ...]
    sizes: tuple[str, ...]
    expert: tuple[str, ...] | None
    shown: int = 20
    trainings: Sequence[int] = TRAININGS

    def sized(self, algorithm: str) -> tuple[str, ...]:
        """Settings of one algorithm."""
        return tuple(f"{algorithm}.{setting}" for setting in self.sizes)


_MANY: Final = range(10)
"""Where a training takes minutes: three resolve nothing, for they differ as much as the arms do."""
_OF_STEPS: Final = "gri.unit=steps"
"""Where a share of episodes is a matter of luck, or most of the steps: few episodes, or short ones at the beginning."""
_CHEETAH_SIZES: Final = ("hidden=[128,128]", "batch=128", "learning_rate=1e-3", "replay.capacity=200000")
_DRIVING_SIZES: Final = (
    "hidden=[128,128]", "batch=32", "learning_rate=5e-4", "gamma=0.97", "updates_per_step=0.25", "target_every=250",
    "learning_starts=500", "round_steps=250", "exploration_steps=8000", "double=true", "dueling=true",
    "replay.capacity=100000", "replay.steps=3", "replay.priority=0.2",
)  # fmt: skip
_PICTURES_SIZES: Final = (
    *_DRIVING_SIZES, "hidden=[256,256]", "learning_rate=2e-4", "updates_per_step=1.0", "target_every=1000",
    "exploration_steps=30000", "replay.capacity=150000",
)  # fmt: skip
"""Four times as many updates as of a state, with a smaller rate: a state has 4,096 numbers, not 51."""
_FULL: Final = ("steps=100000", "evaluate_every=10000", "checkpoint_every=10000", "episodes=10", _OF_STEPS)
_LONG: Final = ("steps=200000", "evaluate_every=20000", "checkpoint_every=20000", "episodes=5")


def _mujoco(env: str) -> Problem:
    """A task of MuJoCo at 100,000 steps, with an expert of 200,000; learning rate, widths and batch as is common."""
    return Problem(env, _FULL, ("replay.capacity=200000", "learning_starts=5000"), _LONG, trainings=_MANY)


PROBLEMS: Final[Mapping[str, Problem]] = MappingProxyType(
    {
        "pendulum": Problem(
            "Pendulum-v1",
            ("steps=4000", "evaluate_every=500", "checkpoint_every=2000", "episodes=10", _OF_STEPS),
            ("hidden=[64,64]", "batch=64", "learning_rate=1e-3", "replay.capacity=50000", "round_steps=500"),
            ("steps=5000", "evaluate_every=2500", "checkpoint_every=5000", "sac.round_steps=1000"),
            trainings=_MANY,
        ),
        "cheetah": Problem(
            "HalfCheetah-v5",
            ("steps=15000", "evaluate_every=2500", "checkpoint_every=5000", "episodes=5", _OF_STEPS),
            (*_CHEETAH_SIZES, "learning_starts=1000", "round_steps=500"),
            ("steps=60000", "evaluate_every=10000", "checkpoint_every=10000", "episodes=5", "sac.round_steps=1000"),
            trainings=_MANY,
        ),
        "driving": Problem(
            "driving-state",
            ("steps=20000", "evaluate_every=4000", "checkpoint_every=4000", "episodes=10"),
            _DRIVING_SIZES,
            None,
            shown=60,
        ),
        "driving-full": Problem(
            "driving-state",
            ("steps=100000", "evaluate_every=10000", "checkpoint_every=10000", "episodes=20"),
            (*_DRIVING_SIZES, "exploration_steps=20000"),
            None,
            shown=60,
        ),
        "driving-vis": Problem(
            "driving-affordances",
            ("steps=40000", "evaluate_every=10000", "checkpoint_every=10000", "episodes=10"),
            _DRIVING_SIZES,
            None,
            shown=60,
        ),
        "driving-vis-full": Problem(
            "driving-affordances-varied",
            ("steps=150000", "evaluate_every=10000", "checkpoint_every=10000", "episodes=10"),
            _PICTURES_SIZES,
            None,
            shown=60,
        ),
        "cheetah-full": _mujoco("HalfCheetah-v5"),
        "walker-full": _mujoco("Walker2d-v5"),
    }
)


@dataclass(frozen=True, slots=True)
class GriArm:
    """Trainings of an arm.

    Attributes:
        problem: Name in `PROBLEMS`.
        algorithm: What learns.
        gri: Settings of GRI, without the table's name.
        told: What it is, in a few words.
        more: Other settings than those of its problem.
        env: Environment in place of its problem's, with other observations; empty: the problem's.
    """

    problem: str
    algorithm: str
    gri: tuple[str, ...]
    told: str
    more: tuple[str, ...] = ()
    env: str = ""

    @property
    def shown(self) -> str:
        """Name of its demonstrations: arms that see the same and have as many bad ones share them."""
        return f"{self.problem}-{100 * self.noise:g}{self.env and f'-{self.env}'}"

    @property
    def noise(self) -> float:
        """Share of bad demonstrations."""
        return self._config((), 0).gri.demo_noise

    def config(self, seed: int, demonstrations: Path) -> GriRunConfig:
        """Settings of a training."""
        return self._config((f"demonstrations={demonstrations}",), seed)

    def _config(self, more: tuple[str, ...], seed: int) -> GriRunConfig:
        problem = PROBLEMS[self.problem]
        settings = (
            *_ALL, *problem.learning, *problem.sized(self.algorithm), *(f"gri.{one}" for one in self.gri),
            f"env={self.env or problem.env}", f"algorithm={self.algorithm}", f"shown={problem.shown}", f"seed={seed}",
            *self.more,
        )  # fmt: skip
        return read_settings(GriRunConfig, None, (*settings, *more))


def expert_config(problem: str) -> GymnasiumConfig:
    """Settings of the training of a problem's expert."""
    found = PROBLEMS[problem]
    settings = (*_ALL, *found.sized("sac"), *(found.expert or ()), f"env={found.env}", "algorithm=sac")
    return read_settings(GymnasiumConfig, None, settings)


def _shares(problem: str, algorithm: str, *percents: int) -> dict[str, GriArm]:
    """An arm for each share of demonstrations."""
    alone = {0: f"{algorithm.upper()} alone", 100: "demonstrations only"}
    return {
        f"{problem}-{algorithm}-p{percent}": GriArm(
            problem,
            algorithm,
            (f"p_demo={percent / 100}",),
            alone.get(percent, f"GRI-{algorithm.upper()}, {percent} %"),
        )
        for percent in percents
    }


def _noisy(problem: str, *percents: int) -> dict[str, GriArm]:
    """An arm for each share of bad demonstrations, at a p_demo of 20 %."""
    return {
        f"{problem}-sac-noise{percent}": GriArm(
            problem, "sac", ("p_demo=0.2", f"demo_noise={percent / 100}"), f"GRI-SAC, 20 %, {percent} % bad"
        )
        for percent in percents
    }


def _driving(problem: str, longer: int) -> dict[str, GriArm]:
    """Row 4: GRIAD, its algorithm alone with as many steps as it explores and as it stores, and negative controls."""
    shown = ("demo_reward=1.0", "unit=steps")
    sqil = ("p_demo=0.5", "explorer_reward=0.0", *shown)
    arms = {
        "p0": GriArm(problem, "iqn", ("p_demo=0.0",), "IQN alone"),
        "p0-long": GriArm(problem, "iqn", ("p_demo=0.0",), "IQN alone, longer", (f"steps={longer}",)),
        "p25": GriArm(problem, "iqn", ("p_demo=0.25", *shown), "GRIAD, 3 to 1"),
        "p100": GriArm(problem, "iqn", ("p_demo=1.0", *shown), "IQN, demonstrations only"),
        "sqil": GriArm(problem, "iqn", sqil, "SQIL", ("iqn.demonstrated_share=0.5",)),
    }
    return {f"{problem}-iqn-{name}": arm for name, arm in arms.items()}


def _encoders(problem: str, conditions: str = "") -> dict[str, GriArm]:
    """Row 5: GRIAD on encoders that learned more, less, or nothing; and its algorithm alone on the first of them.

    Args:
        problem: Name in `PROBLEMS`.
        conditions: End of the environments' names where they have several conditions.
    """
    told = {
        "affordances": "encoder of segmentation and heads",
        "classification": "encoder of classification",
        "untrained": "encoder without training",
    }
    shown = ("p_demo=0.25", "demo_reward=1.0", "unit=steps")
    arms = {
        f"{problem}-iqn-{name}": GriArm(problem, "iqn", shown, f"GRIAD, {words}", env=f"driving-{name}{conditions}")
        for name, words in told.items()
    }
    alone = GriArm(
        problem, "iqn", ("p_demo=0.0",), f"IQN alone, {told['affordances']}", env=f"driving-affordances{conditions}"
    )
    return {f"{problem}-iqn-p0": alone, **arms}


ARMS: Final[Mapping[str, GriArm]] = MappingProxyType(
    {
        **_shares("pendulum", "sac", 0, 10, 20, 30, 40, 60, 100),
        **_shares("pendulum", "ddpg", 0, 20),
        **_noisy("pendulum", 10, 30),
        **_shares("cheetah", "sac", 0, 10, 20, 40),
        **_driving("driving", 26_750),
        **_driving("driving-full", 133_250),
        **_encoders("driving-vis"),
        **_encoders("driving-vis-full", VARIED),
        **_shares("cheetah-full", "sac", 0, 10, 20, 30, 40, 60),
        **_shares("cheetah-full", "ddpg", 0, 20),
        **_noisy("cheetah-full", 10, 30),
        **_shares("walker-full", "sac", 0, 10, 20, 30, 40, 60),
    }
)
