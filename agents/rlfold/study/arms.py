"""Arms of the study of RLfOLD: rows 17 and 18 of the thesis's comparisons, as settings of the trainer `rlfold`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import Final

from dohyo.agents.endless_driving.study.arms import DrivingArm, Reported
from dohyo.agents.studies.claims import Claim, above, of_ablation
from dohyo.agents.studies.training_results import BENCHMARK as TRAINING

_ROOM: Final = Path(__file__).parents[1] / "configs"
PICTURES, TWIN = _ROOM / "rlfold.toml", _ROOM / "twin.toml"
_NEVER: Final = "rlfold.gate=never"
_LAWFUL: Final = "town.obey_lights=true"
_BOUNDED: Final = "rlfold.bounded=true"
_SCALED: Final = "latent.scaled_mixing=true"

_ARMS: Final[Mapping[str, DrivingArm]] = {
    "full": DrivingArm("", PICTURES, (), Reported(100.0, 86.0, 66.0)),
    "no-expert": DrivingArm("no demonstrations", PICTURES, (_NEVER, "rlfold.imitation=none"), Reported(regular=52.0)),
    "one-deviation": DrivingArm("squared error", PICTURES, ("rlfold.imitation=squared",), Reported(regular=64.0)),
    "never": DrivingArm("the expert never drives, p = 0", PICTURES, (_NEVER,), Reported(regular=72.0)),
    "share": DrivingArm(
        "the expert drives at random, p = 0.3", PICTURES, ("rlfold.gate=share",), Reported(regular=80.0)
    ),
    "far-sighted": DrivingArm("a discount of 0.99", PICTURES, ("rlfold.gamma=0.99",)),
    "steering": DrivingArm("steering imitated too", PICTURES, ("rlfold.imitated=speed-and-steering",)),
    "noisy": DrivingArm("30 % random decisions of the expert", PICTURES, ("expert.noise=0.3",)),
    "autopilot": DrivingArm("the autopilot's target speed", PICTURES, ("expert.name=autopilot",)),
    "priboot": DrivingArm("PRIBOOT's target speed", PICTURES, ("expert.name=priboot",)),
    "as-released": DrivingArm("stands at a target of 0 alone", PICTURES, ("town.stand_below=0",)),
    "bounded": DrivingArm("the mean bounded, as released", PICTURES, (_BOUNDED,)),
    "lawful": DrivingArm("lights and stop signs count", PICTURES, (_LAWFUL,)),
    "lawful-bounded": DrivingArm("lights count, the mean bounded", PICTURES, (_LAWFUL, _BOUNDED)),
    "lawful-scaled": DrivingArm("lights count, A-LIX scaled to small maps", PICTURES, (_LAWFUL, _SCALED)),
}
_OF_TWIN: Final = (
    "full", "no-expert", "one-deviation", "never", "share", "far-sighted", "steering", "noisy", "as-released", "lawful",
    "bounded",
)  # fmt: skip


def _twin(name: str) -> DrivingArm:
    arm = _ARMS[name]
    return replace(arm, isolates=f"exact state, {arm.isolates}".removesuffix(", "), config=TWIN, reported=Reported())


_SHORT: Final = ("town.roads=empty", "steps=3000", "evaluate_every=3000", "checkpoint_every=3000")
_EMPTY: Final = {
    f"empty-{name}": replace(
        _twin(name), isolates=f"{_twin(name).isolates}, no traffic", settings=(*_SHORT, *_ARMS[name].settings)
    )
    for name in ("full", "no-expert", "far-sighted")
}
"""Short trainings of the twin in an empty town: does it learn to keep to the route at all?"""
ARMS: Final[Mapping[str, DrivingArm]] = MappingProxyType(
    {**_ARMS, **{f"twin-{name}": _twin(name) for name in _OF_TWIN}, **_EMPTY}
)
_ORDER: Final = ("full", "share", "never", "one-deviation", "no-expert")
"""From the best to the worst in the thesis."""
CLAIMS: Final = (
    *of_ablation(
        17,
        *(Claim(left, ">", right, "success", "regular") for left, right in pairwise(_ORDER)),
        *(Claim(f"twin-{left}", ">", f"twin-{right}", "return", TRAINING) for left, right in pairwise(_ORDER)),
        Claim("twin-full", ">", "twin-far-sighted", "return", TRAINING),
        Claim("twin-bounded", ">", "twin-full", "return", TRAINING),
        Claim("twin-bounded", ">", "twin-no-expert", "return", TRAINING),
        *above("empty-full", "empty-no-expert", "empty-far-sighted", measure="success", where="empty"),
    ),
    *of_ablation(18, *above("full", "steering", "noisy", measure="success", where="regular")),
)
"""Directions of the thesis's results."""
