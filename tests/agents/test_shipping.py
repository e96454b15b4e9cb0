"""Shipping: weights with their card, and the files that list agents."""

from __future__ import annotations

import json
import re
import shutil
import tomllib
from pathlib import Path

import pytest

from dohyo.agents.endless_driving.config import TownConfig
from dohyo.agents.learning.files.card import read_card
from dohyo.agents.rlad.agent import Rlad
from dohyo.agents.shipping import ROOT, ship
from dohyo.sumo_networks.errors import InvalidInputError
from tests.agents.endless_driving.policies import drawn_policy

LISTS = ("pyproject.toml", "agents/agents.toml", "agents/settings.json")


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A checkout with the files that list agents, none of which has RLAD."""
    (tmp_path / "agents" / "rlad").mkdir(parents=True)
    for name in LISTS:
        shutil.copy(ROOT / name, tmp_path / name)
    project, declared, settings = (tmp_path / name for name in LISTS)
    project.write_text(re.sub(r"^rlad = .*\n", "", project.read_text(), flags=re.MULTILINE))
    declared.write_text(re.sub(r"\n\[rlad\]\n(?:\w.*\n)*", "", declared.read_text()))
    schemas = json.loads(settings.read_text())
    schemas.pop("rlad", None)
    settings.write_text(json.dumps(schemas))
    return tmp_path


def test_weights_are_shipped_with_their_card_and_the_name_is_registered_once(root: Path) -> None:
    drawn_policy(root / "run", TownConfig())
    assert not any("rlad" in (root / name).read_text() for name in LISTS[1:])
    shipped = ship("rlad", root / "run", root)
    assert ship("rlad", root / "run", root) == shipped == root / "agents" / "rlad" / "checkpoints" / "rlad.onnx"
    assert read_card(shipped).trainer == "rlad"
    spec = Rlad(shipped).spec
    project = tomllib.loads((root / LISTS[0]).read_text())
    assert project["project"]["entry-points"]["dohyo.agents"]["rlad"] == "dohyo.agents.rlad.agent:Rlad"
    declared = tomllib.loads((root / LISTS[1]).read_text())["rlad"]
    assert (declared["track"], declared["control"]) == (spec.track, spec.control)
    assert tuple(declared["sensors"]) == spec.sensors
    assert list(json.loads((root / LISTS[2]).read_text())["rlad"]["properties"]) == ["policy"]


def test_what_does_not_drive_is_not_shipped(root: Path) -> None:
    drawn_policy(root / "run", TownConfig(), trainer="rlfold")
    before = [(root / name).read_bytes() for name in LISTS]
    with pytest.raises(InvalidInputError, match="expected a policy of trainer 'rlad'"):
        ship("rlad", root / "run", root)
    assert [(root / name).read_bytes() for name in LISTS] == before
    assert not (root / "agents" / "rlad" / "checkpoints").exists()
