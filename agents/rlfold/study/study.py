"""Study `rlfold`: rows 17 and 18 of the thesis's comparisons. The same command resumes trainings and drives.

python -m dohyo.agents.studies rlfold run --set runs=out/rlfold --arms full --trainings 0
python -m dohyo.agents.studies rlfold run --set runs=out/rlfold train=false     # drive what is trained so far
python -m dohyo.agents.studies rlfold table --rows out/studies/rlfold
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from dohyo.agents.endless_driving.study.system import study_of
from dohyo.agents.rlfold.study.arms import ARMS, CLAIMS
from dohyo.agents.rlfold.training import RLFOLD

ROOM: Final = Path(__file__).parents[1]
STUDY: Final = study_of("RLfOLD: its parts, and the quality of its expert", ROOM, "rlfold", RLFOLD, ARMS, CLAIMS)
