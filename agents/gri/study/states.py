"""Study `griad`: row 4 in the unseen town, where the driver sees the exact state.

    python -m dohyo.agents.studies griad run --set runs=out/gri --arms driving-full-iqn-p25 --trainings 0
    python -m dohyo.agents.studies griad table --rows out/studies/griad

Missions and judgement are those of `unseen`.
"""

from __future__ import annotations

from typing import Final

from dohyo.agents.endless_driving.study.tables import TRAFFIC
from dohyo.agents.gri.study.unseen import unseen_study
from dohyo.agents.studies.claims import Claim, of_ablation

GRIAD, ALONE = "driving-full-iqn-p25", "driving-full-iqn-p0"
CLAIMS: Final = of_ablation(
    4,
    *(Claim(GRIAD, ">", ALONE, "success", traffic) for traffic in (*TRAFFIC, "")),
    Claim(GRIAD, ">", f"{ALONE}-long", "success"),
    Claim("driving-full-iqn-sqil", "<", GRIAD, "success"),
    Claim("driving-full-iqn-p100", "<", ALONE, "success"),
)
STUDY: Final = unseen_study(
    ("driving-full",),
    CLAIMS,
    {
        ALONE: (60.6, 59.3, 40.0),
        f"{ALONE}-long": (62.0, 56.7, 46.0),
        GRIAD: (68.7, 63.3, 52.0),
        "driving-full-iqn-p100": (0.0, 0.0, 0.0),
        "driving-full-iqn-sqil": (0.0, 0.0, 0.0),
    },
    "unseen",
    "GRIAD in NoCrash's unseen town under unseen conditions, beside its algorithm alone",
)
"""Row 4; the thesis's numbers are of its table 4.2 and its text."""
