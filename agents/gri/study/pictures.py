"""Study `griad-pictures`: row 5, and row 4's main claim, where the driver sees three cameras through A-VIS.

    python -m dohyo.agents.studies griad-pictures run --set runs=out/gri --trainings 0

Missions and judgement are those of `unseen`.
"""

from __future__ import annotations

from typing import Final

from dohyo.agents.endless_driving.study.tables import TRAFFIC
from dohyo.agents.gri.study.unseen import unseen_study
from dohyo.agents.studies.claims import Claim, above, of_ablation

WHOLE, ALONE = "driving-vis-iqn-affordances", "driving-vis-iqn-p0"
LESS: Final = ("driving-vis-iqn-classification", "driving-vis-iqn-untrained")
CLAIMS: Final = (
    *of_ablation(5, *above(WHOLE, *LESS, measure="success"), *above(WHOLE, *LESS, measure="route_completion")),
    *of_ablation(5, *above(WHOLE, *LESS, measure="success", where=TRAFFIC[-1])),
    *of_ablation(4, Claim(WHOLE, ">", ALONE, "success"), Claim(WHOLE, ">", ALONE, "route_completion")),
)
STUDY: Final = unseen_study(
    "driving-vis", CLAIMS, {}, "pictures", "GRIAD from pictures in NoCrash's unseen town, by what its encoder learned"
)
"""The thesis has no such table: its encoders are compared with another author's, in the weather of training."""
