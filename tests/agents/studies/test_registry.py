"""Studies are found where the systems list them, and what finds them names none."""

from __future__ import annotations

import re
from pathlib import Path

from dohyo.agents.studies.registry import studies, study_named
from dohyo.agents.studies.study import Study

AGENTS = Path(__file__).parents[3] / "agents"
BELOW = {"learning", "registry", "studies"}


def test_every_study_of_a_room_is_listed_there() -> None:
    listed = {entry.partition(":")[0] for entry in studies().values()}
    assert list(studies()) == sorted(studies())
    made = {
        "dohyo.agents." + ".".join(path.relative_to(AGENTS).with_suffix("").parts)
        for path in AGENTS.glob("*/study/*.py")
        if re.search(r"^STUDY(: Final)? = ", path.read_text(), re.M)
    }
    assert listed == made
    assert isinstance(study_named("gri"), Study)


def test_the_machinery_names_no_system() -> None:
    named = {
        name
        for path in (AGENTS / "studies").glob("*.py")
        for name in re.findall(r"dohyo\.agents\.(\w+)", path.read_text())
    }
    assert named <= BELOW
