"""Arms of the study of RLAD: rows 14 to 16 of the thesis's comparisons, as settings of the trainer `rlad`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Final

from dohyo.agents.endless_driving.study.arms import DrivingArm, Reported
from dohyo.agents.studies.claims import Claim, above, of_ablation
from dohyo.agents.studies.training_results import BENCHMARK as TRAINING

_ROOM: Final = Path(__file__).parents[1] / "configs"
PICTURES, TWIN = _ROOM / "rlad.toml", _ROOM / "twin.toml"
_SHORT: Final = ("steps=6000", "evaluate_every=2000", "checkpoint_every=1000", "sac.round_steps=500")
"""First stages: does it learn anything at all?"""
_ONE_ROUTE: Final = (
    "town.roads=one-route", "steps=2700", "evaluate_every=750", "checkpoint_every=500", "sac.round_steps=250",
    "sac.learning_starts=300", "sac.batch=32",
)  # fmt: skip
_RELEASED: Final = ("town.stand_below=0", "sac.gamma=0.99")
_PLAIN: Final = ("latent.waypoints=plain", "latent.local_mixing=false")
_UNSCALED: Final = "latent.scaled_mixing=false"
_HALF, _THIRD = "steps=15000", "steps=10000"
"""Budgets of the arms that differ by a part, and of the comparison with the rivals."""
_BEFORE: Final = ("steps=20000", _UNSCALED)
"""The configuration before A-LIX was scaled."""


_EARLIER: Final = ("drq_v2.noise_steps=1500", "drq_v2.learning_rate=1e-3")
"""DrQ-v2's noise ends after as much of the training as in its source; it learns at the rate of the others."""


def _rival(algorithm: str, reported: Reported, *more: str) -> DrivingArm:
    return DrivingArm("a rival", PICTURES, (_THIRD, f"algorithm={algorithm}", *_PLAIN, *more), reported)


def _part(isolates: str, setting: str, reported: Reported) -> DrivingArm:
    return DrivingArm(isolates, PICTURES, (_HALF, setting), reported)


ARMS: Final[Mapping[str, DrivingArm]] = MappingProxyType(
    {
        "rlad": DrivingArm("", PICTURES, (), Reported(94.0, 62.0, 32.0)),
        "rlad-half": DrivingArm("half of the steps", PICTURES, (_HALF,)),
        "no-waypoint-convolution": _part("plain layers", "latent.waypoints=plain", Reported(regular=58.0)),
        "no-light-loss": _part("no loss of lights", "light_loss=false", Reported(regular=49.0)),
        "no-local-mixing": _part("no A-LIX", "latent.local_mixing=false", Reported(regular=51.0)),
        "unscaled-mixing": _part("A-LIX shifts all maps by as many pixels", _UNSCALED, Reported()),
        "no-shifts": _part("no random shift, as released", "shifts=false", Reported()),
        "no-standing": _part("stands at a target of 0 alone", "town.stand_below=0", Reported()),
        "far-sighted": _part("a discount of 0.99", "sac.gamma=0.99", Reported()),
        "shipped-before": DrivingArm("A-LIX not scaled", PICTURES, _BEFORE),
        "as-released": DrivingArm(
            "creeps, far-sighted, A-LIX not scaled", PICTURES, (*_RELEASED, "steps=50000", _UNSCALED)
        ),
        "rlad-short": DrivingArm("as short as the rivals", PICTURES, (_THIRD,), Reported(94.0, 62.0, 32.0)),
        "unscaled-short": DrivingArm("A-LIX not scaled, as short", PICTURES, (_THIRD, _UNSCALED)),
        "sac-ae": _rival("sac-ae", Reported(82.0, 42.0, 6.0)),
        "curl": _rival("curl", Reported(74.0, 30.0, 2.0)),
        "drq": _rival("drq", Reported(94.0, 42.0, 10.0)),
        "drq-v2": _rival("drq-v2", Reported(10.0, 8.0, 0.0), *_EARLIER),
        "small-encoder": _part("0.06 M encoder", "latent.layers=[[8, 4], [16, 2], [8, 1]]", Reported()),
        "large-encoder": _part("1.4 M encoder", "latent.layers=[[48, 4], [96, 2], [192, 1]]", Reported()),
        "one-route": DrivingArm("one route, again and again", PICTURES, _ONE_ROUTE),
        "empty-town": DrivingArm("no traffic", PICTURES, ("town.roads=empty", *_SHORT)),
        "twin": DrivingArm("exact state", TWIN),
        "twin-far-sighted": DrivingArm("exact state, a discount of 0.99", TWIN, ("sac.gamma=0.99",)),
        "twin-as-released": DrivingArm(
            "exact state; creeps, far-sighted, small batches", TWIN, (*_RELEASED, "sac.batch=64")
        ),
        "twin-no-waypoint-convolution": DrivingArm("exact state, plain layers", TWIN, ("latent.waypoints=plain",)),
    }
)
_RIVALS: Final = ("drq", "sac-ae", "curl")
CLAIMS: Final = (
    *of_ablation(
        15,
        *above("rlad-short", *_RIVALS, measure="success", where="regular"),
        *above("rlad-short", *_RIVALS, measure="success", where="dense"),
        *above("unscaled-short", *_RIVALS, measure="success", where="regular"),
        *(Claim(arm, ">", "drq-v2", "success", "regular") for arm in _RIVALS),
    ),
    *of_ablation(
        14,
        *above(
            "rlad-half",
            "no-waypoint-convolution",
            "no-light-loss",
            "no-local-mixing",
            measure="success",
            where="regular",
        ),
        Claim("rlad-half", ">", "unscaled-mixing", "success", "regular"),
        Claim("twin", "<", "twin-no-waypoint-convolution", "lateral_m", TRAINING),
    ),
    *of_ablation(16, *above("rlad-half", "small-encoder", "large-encoder", measure="return", where=TRAINING)),
)
"""Directions of the thesis's results."""
