"""Study `griad-pictures`: row 5, and row 4's main claim, where the driver sees three cameras through A-VIS.

Arms of `driving-vis` have 40,000 steps; those of `driving-vis-full` 150,000, and 15 times as many updates.

    python -m dohyo.agents.studies griad-pictures run --set runs=out/gri --trainings 0

Missions and judgement are those of `unseen`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from dohyo.agents.endless_driving.study.tables import TRAFFIC
from dohyo.agents.gri.study.unseen import unseen_study
from dohyo.agents.studies.claims import Claim, above, of_ablation

SHORT, FULL = "driving-vis", "driving-vis-full"


def _claims(problem: str) -> Iterator[Claim]:
    whole, *less = (f"{problem}-iqn-{name}" for name in ("affordances", "classification", "untrained"))
    yield from of_ablation(5, *above(whole, *less, measure="success"), *above(whole, *less, measure="route_completion"))
    yield from of_ablation(5, *above(whole, *less, measure="success", where=TRAFFIC[-1]))
    alone = f"{problem}-iqn-p0"
    yield from of_ablation(4, Claim(whole, ">", alone, "success"), Claim(whole, ">", alone, "route_completion"))


CLAIMS: Final = tuple(claim for problem in (SHORT, FULL) for claim in _claims(problem))
STUDY: Final = unseen_study(
    (SHORT, FULL), CLAIMS, {}, "pictures", "GRIAD from pictures in NoCrash's unseen town, by what its encoder learned"
)
"""The thesis has no such table: its encoders are compared with another author's, in the conditions of training."""
