"""Arms of the parking study: rows 22 to 25 of the thesis's comparisons, as settings of the trainer `parking`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Final

from dohyo.agents.learning.files.settings import read_settings
from dohyo.agents.parking.training.dppo_il import ParkingConfig

SETTINGS: Final = Path(__file__).parents[1] / "configs" / "parking.toml"
EXPERT: Final = "expert"
"""Arm without a training."""
WHOLE: Final = ("bco=true", "gail=true", "curiosity=true")
"""Settings of DPPO-IL."""
_SIMPLE: Final = ("scene=simple", "reward=simple", "steps=800000", "ppo.gamma=0.99", "sac.gamma=0.99")
_GRADED: Final = (*WHOLE, "reward=graded")
_THREE: Final = (*_GRADED, "karts=3", "environments=258", "lots=86")
_LONG: Final = ("steps=6000000", "ppo.learning_rate_decay=0.995")
"""Three times the steps, over which the learning rate falls as far."""
_LONGEST: Final = ("steps=12000000", "ppo.learning_rate_decay=0.9975")


@dataclass(frozen=True, slots=True)
class ParkingArm:
    """Trainings of an arm.

    Attributes:
        isolates: Difference from the other arms.
        benchmarks: That its policies are judged on, the first is what they learned.
        settings: On top of `SETTINGS`.
        reported: Success that the thesis reports, %; None without one.
    """

    isolates: str
    benchmarks: tuple[str, ...]
    settings: tuple[str, ...] = ()
    reported: float | None = None

    def config(self, seed: int) -> ParkingConfig:
        """Settings of a training."""
        return read_settings(ParkingConfig, SETTINGS, (*self.settings, f"seed={seed}"))


ONE, THREE, SIMPLE = "parking-complex", "parking-three", "parking-simple"
REACHED: Final = "parking-simple, reached"
"""The lots of `SIMPLE`, judged by the thesis's first reward: a kart's centre comes within 0.5 m of its spot's, at any
speed. The judge also demands that it stands there for 1 s, which that reward does not teach."""
UNSEEN: Final = ("parking-parallel", "parking-angled", "parking-pedestrians")
"""Kinds of spot and pedestrians that no policy trains on."""
ARMS: Final[Mapping[str, ParkingArm]] = MappingProxyType(
    {
        EXPERT: ParkingArm("hybrid A* and a tracker, with the whole lot known", (SIMPLE, ONE, *UNSEEN, THREE)),
        "simple-ppo": ParkingArm("PPO, simple scene", (REACHED, SIMPLE), _SIMPLE, 98.0),
        "simple-poca": ParkingArm("MA-POCA, simple scene", (REACHED, SIMPLE), (*_SIMPLE, "algorithm=poca")),
        "simple-sac": ParkingArm("SAC, simple scene", (REACHED, SIMPLE), (*_SIMPLE, "algorithm=sac")),
        "ppo": ParkingArm("PPO", (ONE,), (), 74.8),
        "dppo": ParkingArm("PPO and curiosity", (ONE,), ("curiosity=true",)),
        "dppo-gail": ParkingArm("PPO, curiosity and GAIL", (ONE,), ("curiosity=true", "gail=true")),
        "dppo-il": ParkingArm("PPO, curiosity, GAIL and BCO", (ONE, *UNSEEN, THREE), WHOLE, 92.0),
        "graded": ParkingArm("DPPO-IL, a bonus for alignment", (ONE, *UNSEEN, THREE), _GRADED),
        "graded-long": ParkingArm("graded, 3 million steps", (ONE, *UNSEEN, THREE), (*_GRADED, "steps=3000000")),
        "without-dwell": ParkingArm("DPPO-IL, no dwell", (ONE,), (*WHOLE, "reward=without-dwell")),
        "without-alignment": ParkingArm("DPPO-IL, no angles", (ONE,), (*WHOLE, "reward=without-alignment")),
        "three": ParkingArm("three karts, graded", (THREE,), _THREE, 81.0),
        "three-curriculum": ParkingArm("three karts, graded, curriculum", (THREE,), (*_THREE, "gradual=true"), 90.0),
        "three-long": ParkingArm("three karts, 6 million steps", (THREE,), (*_THREE, *_LONG), 81.0),
        "three-longest": ParkingArm("three karts, 12 million steps", (THREE,), (*_THREE, *_LONGEST), 81.0),
        "three-curriculum-long": ParkingArm(
            "three karts, curriculum, 6 million steps", (THREE,), (*_THREE, *_LONG, "gradual=true"), 90.0
        ),
    }
)
