"""Arms of MBAPPE's study: rows 6 to 9 of the thesis's comparisons and baselines, and what they drive."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Final

from dohyo.agents.studies.arms import Arm
from dohyo.agents.studies.samples import Sample

BEFORE: Mapping[str, Any] = MappingProxyType(
    {"keeps_lane": False, "room_for_people": False, "drives_off": False, "looks_ahead": False}
)
"""Of all arms: the drives are stored, and older than these settings."""


def _mbappe(reported: float | None = None, **settings: Any) -> Arm:
    return Arm("mbappe", MappingProxyType({**BEFORE, **settings}), reported=reported)


THESIS: Mapping[str, Any] = MappingProxyType(
    {
        "crafted": "limit", "steering": "wheel", "simulator": "thesis", "walks": "node", "first_play": "zero",
        "choice": "visits", "early_stop": True, "reuse": False, "emergency": False, "caution": False, "passing": False,
        **BEFORE,
    }
)  # fmt: skip
"""The thesis's planner whole, see CHOICES.md: its grid, priors, reward and search, and none of our additions."""
ARMS: Mapping[str, Arm] = MappingProxyType(
    {
        "autopilot": Arm("autopilot"),
        "mbappe": _mbappe(86),
        "prior-none": _mbappe(26, prior="none"),
        "prior-learned": _mbappe(65, prior="learned"),
        "prior-crafted": _mbappe(82, prior="crafted"),
        "constraints-none": _mbappe(79, constraints="none"),
        "constraints-tree": _mbappe(82, constraints="tree"),
        "constraints-node": _mbappe(82, constraints="node"),
        "predictor-constant_velocity": _mbappe(predictor="constant_velocity"),
        "predictor-idm": _mbappe(predictor="idm"),
        "alone-constant_velocity": Arm("predictor-only", MappingProxyType({"predictor": "constant_velocity"})),
        "alone-idm": Arm("predictor-only", MappingProxyType({"predictor": "idm"})),
        "alone-learned": Arm("predictor-only", MappingProxyType({"predictor": "learned"}), reported=47),
        "hold-0.1s": _mbappe(hold_s=0.1),
        "thesis-crafted": _mbappe(crafted="limit", first_play="zero", choice="visits", reuse=False, passing=False),
        "thesis-wheel": _mbappe(steering="wheel", passing=False),
        "thesis": _mbappe(86, **THESIS),
        "thesis-prior-none": _mbappe(26, prior="none", **THESIS),
        "thesis-prior-learned": _mbappe(65, prior="learned", **THESIS),
        "thesis-prior-crafted": _mbappe(82, prior="crafted", **THESIS),
        "learned-everywhere": _mbappe(learned_prior_s=8.0),
        "no-reuse": _mbappe(reuse=False),
        "choice-q": _mbappe(choice="q"),
        "choice-visits": _mbappe(choice="visits"),
        "value-network": _mbappe(value="network"),
        "random-shooting": Arm("random-shooting", BEFORE),
        "idm": Arm("idm", reported=76),
        "pdm-closed": Arm("pdm-closed", MappingProxyType({"looks_ahead": False})),
        "pdm-published": Arm("pdm-closed", MappingProxyType({"variant": "published"}), reported=92),
    }
)
"""The base is `mbappe`: both priors, both constraints, the learned predictor, 1 s hold, and `BEFORE`. PDM-Closed is as
it was then, too. Reported: the thesis's score on nuPlan's Val14, %."""
LEARNERS: Final = ("mbappe", "random-shooting", "predictor-only")
"""Agents that read a trained predictor, unless their settings name another one."""


def is_trained(arm: Arm) -> bool:
    """Whether a trained network has a part in an arm: the predictor, whose ego is the learned prior, or the value."""
    predicts = arm.settings.get("predictor", "learned") == "learned"
    return arm.agent in LEARNERS and (predicts or arm.settings.get("value") == "network")


TRAINED: Final = frozenset(name for name, arm in ARMS.items() if is_trained(arm))

PLANNERS: Final = ("autopilot", "mbappe", "pdm-closed")
"""Planners that drive whole routes, and whose lost points are listed by cause."""
DRIVEN: Mapping[str, tuple[Sample, tuple[str, ...]]] = MappingProxyType(
    {
        "val14": (Sample("val14", remainder=0), tuple(ARMS)),
        "val14-reactive": (
            Sample("val14-reactive", remainder=0, per_type=5),
            ("autopilot", "mbappe", "idm", "pdm-closed"),
        ),
        "nocrash town-test.dense.test": (Sample("nocrash", ("town-test.dense.test",)), PLANNERS),
        "nocrash town-test.dense.train": (Sample("nocrash", ("town-test.dense.train",)), PLANNERS),
        "leaderboard": (Sample("leaderboard"), PLANNERS),
    }
)
"""Scenarios and arms of each section of RESULTS.md."""
