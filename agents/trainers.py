"""Trainers of `dohyo train`, by name."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from dohyo.agents.learning.runs.trainer import Trainer
from dohyo.evaluation.entry import load_entry
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError


@dataclass(frozen=True, slots=True)
class Listed:
    """A trainer of this package, as `dohyo train --list` shows it without importing it.

    Attributes:
        at: "module:attribute" of the `Trainer`.
        summary: The trainer's own.
        writes: Names of the resulting files in the run's folder.
    """

    at: str
    summary: str
    writes: str = "best.*, policy.*"


def _subpolicy(name: str, summary: str) -> Listed:
    return Listed(f"dohyo.agents.hierarchical.training.subpolicies:{name.upper()}", summary)


TRAINERS: dict[str, Listed] = {
    "gymnasium": Listed(
        "dohyo.agents.learning.gymnasium.task:GYMNASIUM", "any gymnasium environment, by PPO, SAC, DDPG or IQN"
    ),
    "predictor": Listed(
        "dohyo.agents.mcts.predictors.train:PREDICTOR",
        "motion predictor of MBAPPE, from a motion data set",
        "predictor.safetensors, predictor.onnx",
    ),
    "pdm-offset": Listed(
        "dohyo.agents.pdm_hybrid.training:OFFSET",
        "PDM-Hybrid's offset to PDM-Closed's plan, from a motion data set",
        "best.safetensors, best.onnx",
    ),
    "value": Listed(
        "dohyo.agents.mcts.value.train:VALUE",
        "value network of MBAPPE, from searches of a motion data set's scenes",
        "value.safetensors",
    ),
    "semantic": Listed(
        "dohyo.agents.hierarchical.vision.train:SEMANTIC",
        "autoencoder of semantic pictures, from a semantic data set",
        "semantic.safetensors, autoencoder.safetensors",
    ),
    "hierarchical-lane": _subpolicy("lane", "GHRL's sub-policy that keeps its lane"),
    "hierarchical-left": _subpolicy("left", "GHRL's sub-policy that changes to the lane on the left"),
    "hierarchical-right": _subpolicy("right", "GHRL's sub-policy that changes to the lane on the right"),
    "hierarchical-braking": _subpolicy("braking", "GHRL's sub-policy that stops for what is in the way, and drives on"),
    "hierarchical-lights": _subpolicy("lights", "GHRL's sub-policy for junctions with lights"),
    "hierarchical-flat": _subpolicy("flat", "the flat policy that GHRL is compared with: everything in one"),
    "hierarchical-master": Listed(
        "dohyo.agents.hierarchical.training.master_training:MASTER",
        "GHRL's master: chooses among the sub-policies, by option-critic",
    ),
    "speed-buffer": Listed(
        "dohyo.agents.speed_planning.training.buffer_training:BUFFER", "density of the buffer before a bottleneck"
    ),
    "cruise-control": Listed(
        "dohyo.agents.speed_planning.training.cruise_control_training:CRUISE_CONTROL",
        "set-points of a car's cruise control",
    ),
    "parking": Listed(
        "dohyo.agents.parking.training.dppo_il:PARKING", "parking of karts, by PPO, SAC, MA-POCA or DPPO-IL"
    ),
    "gri": Listed(
        "dohyo.agents.gri.training:GRI",
        "driving, or any gymnasium environment, with demonstrations (GRI)",
    ),
    "affordances": Listed(
        "dohyo.agents.gri.vision.train:AFFORDANCES",
        "GRIAD's encoder of three cameras, from a data set of affordances",
        "affordances.onnx (or classification.onnx, untrained.onnx), whole.safetensors",
    ),
    "rlad": Listed(
        "dohyo.agents.rlad.training:RLAD",
        "target speed and steering from pictures, by RLAD or by SAC+AE, CURL, DrQ, DrQ-v2",
    ),
    "rlfold": Listed(
        "dohyo.agents.rlfold.training:RLFOLD",
        "target speed and steering by RLfOLD: SAC, an expert's labels, and a gate",
    ),
    "priboot": Listed(
        "dohyo.agents.priboot.training.train:PRIBOOT",
        "waypoints of PRIBOOT, from recorded demonstrations",
        "priboot.safetensors, priboot.onnx",
    ),
}


def trainer_named(name: str) -> Trainer[Any]:
    """The trainer of that name, or of that "module:attribute".

    Raises:
        UnknownNameError: There is no such trainer.
        InvalidInputError: There is no such module, or no trainer in it.
    """
    if name not in TRAINERS and ":" not in name:
        raise UnknownNameError("trainer", name, TRAINERS)
    entry = TRAINERS[name].at if name in TRAINERS else name
    trainer = load_entry(entry, "trainer")
    if not isinstance(trainer, Trainer):
        raise InvalidInputError(f"'{entry}': expected a Trainer, got {type(trainer).__name__}")
    return trainer
