"""Study `rlad`: rows 14 to 16 of the thesis's comparisons. The same command resumes trainings and drives.

python -m dohyo.agents.studies rlad run --set runs=out/rlad --arms rlad --trainings 0
python -m dohyo.agents.studies rlad run --set runs=out/rlad train=false     # drive what is trained so far
python -m dohyo.agents.studies rlad table --rows out/studies/rlad
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from dohyo.agents.endless_driving.study.system import study_of
from dohyo.agents.rlad.study.arms import ARMS, CLAIMS
from dohyo.agents.rlad.training import RLAD

ROOM: Final = Path(__file__).parents[1]
STUDY: Final = study_of("RLAD: its parts, its rivals, its encoder's size", ROOM, "rlad", RLAD, ARMS, CLAIMS)
