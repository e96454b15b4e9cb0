"""What the interface says of a kart's observation: each state has the numbers of its own columns."""

from __future__ import annotations

import re

import pytest

from dohyo.service.parking.interface import SENSORS, sensor_documents, state_of
from dohyo.sumo_networks.parking.observation import RADAR, columns

FIRST_OF_RADAR = {"parking-v1": 9, "parking-v2": 12, "parking-oriented": 19}


@pytest.mark.parametrize("sensor", SENSORS)
def test_the_table_of_a_state_numbers_its_own_columns(sensor: str) -> None:
    document = sensor_documents()[sensor]
    rows = re.findall(r"^\| (\d+)(?:-(\d+))? \| (.+?) \|", document["description"], re.MULTILINE)
    numbers = [number for first, last, _ in rows for number in range(int(first), int(last or first) + 1)]
    assert numbers == list(range(document["shape"][0]))
    first, _, meaning = rows[-1]
    assert meaning.startswith("radar")
    assert int(first) == FIRST_OF_RADAR[sensor] == columns(state_of(sensor)).tolist().index(RADAR)
