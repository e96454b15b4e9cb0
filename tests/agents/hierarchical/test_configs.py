"""The shipped configurations can be read by the trainers that their first lines name, and hold the thesis's table."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from dohyo.agents.hierarchical.hierarchy import FLAT, MASTER
from dohyo.agents.hierarchical.options.manoeuvres import DRIVE, Manoeuvre
from dohyo.agents.learning.files.settings import read_settings
from dohyo.agents.trainers import TRAINERS, trainer_named

CONFIGS = Path(__file__).parents[3] / "agents" / "hierarchical" / "configs"
FILES = {**{name.value: name.value for name in Manoeuvre}, FLAT: DRIVE, MASTER: MASTER}
TABLE_6_1 = {"clip": 0.2, "gamma": 0.99, "gae_lambda": 0.95, "value_scale": 1.0}
"""What a tenth of the thesis's steps does not ask to be changed."""


@pytest.mark.parametrize(("name", "file"), FILES.items())
def test_a_configuration_is_read_by_its_trainer(name, file):
    path = CONFIGS / f"{file}.toml"
    named = re.search(r"dohyo train (\S+) --config (\S+)", path.read_text())
    assert named is not None
    assert named[1] == f"hierarchical-{name}"
    assert CONFIGS.parents[2] / named[2] == path
    settings = read_settings(trainer_named(named[1]).config, path)
    assert settings.tier == 2
    if name != MASTER:
        assert {key: getattr(settings.ppo, key) for key in TABLE_6_1} == TABLE_6_1
        assert settings.ppo.guided_share == 0.1
        assert settings.processes == 0
        assert settings.state.vision == "none"


def test_every_trainer_has_its_configuration():
    mine = {name.removeprefix("hierarchical-") for name in TRAINERS if name.startswith("hierarchical-")}
    assert mine == FILES.keys()
    assert {path.stem for path in CONFIGS.glob("*.toml")} == set(FILES.values())
