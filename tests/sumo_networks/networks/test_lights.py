"""Lights: endless ones are found in every spelling that XML and SUMO allow."""

from __future__ import annotations

from pathlib import Path

import pytest

from dohyo.sumo_networks.networks.lights import endless_lights
from dohyo.sumo_networks.networks.network import read_network
from tests.worlds import lit_crossing

LIGHT = '<tlLogic id="c" type="static" programID="0" offset="0">'


@pytest.mark.parametrize(
    ("light", "duration", "endless"),
    [
        (LIGHT, 'duration="151"', True),
        (LIGHT, 'duration="150"', False),
        ('<tlLogic type="static" id="c" programID="0" offset="0">', 'duration="151"', True),
        ("<tlLogic id='c' type='static' programID='0' offset='0'>", "duration='151'", True),
        ('<tlLogic\n id = "c" type = "static" programID = "0" offset = "0">', 'duration = "151"', True),
        ('<tlLogic id="&#99;" type="static" programID="0" offset="0">', 'duration="1.51e2"', True),
        (LIGHT, 'duration="0:02:31"', True),
        (LIGHT, 'duration="0:02:30"', False),
    ],
)
def test_endless_lights(light: str, duration: str, endless: bool, tmp_path: Path) -> None:
    before, start, rest = lit_crossing().network.path.read_text().partition(LIGHT)
    assert start
    attribute = rest[rest.index("duration=") : rest.index('" state')] + '"'
    net = tmp_path / "town.net.xml"
    net.write_text(before + light + rest.replace(attribute, duration, 1))
    assert endless_lights(read_network(net, "town")) == ({"c"} if endless else set())
