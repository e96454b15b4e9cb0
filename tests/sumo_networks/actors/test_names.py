"""Names: what is made is read back, and foreign names have no role."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dohyo.sumo_networks.actors.names import (
    Role,
    ego_proxy,
    event_actor,
    event_vehicle,
    is_event_actor,
    numbered,
    predicted,
    role_of,
)

GIVEN = st.from_regex(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,20}", fullmatch=True)


@pytest.mark.parametrize("role", Role)
def test_a_numbered_name_says_its_role_also_where_it_is_predicted(role: Role) -> None:
    assert role_of(numbered(role, 12)) is role
    assert not is_event_actor(numbered(role, 12))
    assert role_of(predicted(numbered(role, 12))) is role


@given(name=GIVEN, number=st.integers(0, 99))
def test_what_a_scenario_calls_its_events_and_egos_does_not_change_their_role(name: str, number: int) -> None:
    assert role_of(event_actor(name, number)) is role_of(event_vehicle(name, number)) is Role.EVENT
    assert is_event_actor(event_actor(name, number))
    assert not is_event_actor(event_vehicle(name, number))
    assert role_of(ego_proxy(name)) is Role.EGO


@pytest.mark.parametrize("name", ["", "17", "parked", "Vehicle-1", "vehicles-1"])
def test_a_foreign_name_has_no_role(name: str) -> None:
    assert role_of(name) is None
