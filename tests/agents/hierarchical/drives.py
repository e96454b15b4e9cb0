"""Hand-made rows of a study."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from dohyo.agents.studies.rows import Row


def a_drive(**changes: object) -> Row:
    """A success of the rules, but for what is changed."""
    drive: Row = {
        "benchmark": "precrash", "arm": "rules", "training_seed": None, "cell": "a", "scenario": "m0", "seed": 0,
        "event": None, "status": "completed", "success": True, "infractions": [], "duration_s": 10.0,
    }  # fmt: skip
    return drive | changes


def drives_of(arm: str, successes: Mapping[int | None, Sequence[int]], **changes: object) -> list[Row]:
    """One drive per scenario, by seed of the training."""
    prefix = "" if "cell" not in changes else f"{changes['cell']}."
    return [
        a_drive(arm=arm, training_seed=seed, scenario=f"{prefix}m{i}", success=bool(one), **changes)
        for seed, ended in successes.items()
        for i, one in enumerate(ended)
    ]
