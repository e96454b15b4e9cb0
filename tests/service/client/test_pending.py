"""PendingConnection: what passes by itself, such as a restart of the service behind a proxy, ends no learning."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from gymnasium.spaces import Box, Dict

from dohyo.service.client import pending
from dohyo.service.client.connection import Pauses, UnreachableError, WireError
from dohyo.service.client.pending import PendingConnection
from dohyo.service.client.remote_env import RemoteWorld, RemoteWorlds
from dohyo.sumo_networks.errors import InvalidInputError
from tests.service.client.scripted import BROKEN, Answer, Script, serving

AWAY = [*(Answer({}, status) for status in (500, 502, 503, 504)), BROKEN]
BUSY = Answer({"detail": "the tick still waits"}, 503, {"retry-after": "0"})
SEEN = Answer({"tick": 1})


@pytest.fixture(autouse=True)
def _soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Pauses, "next", lambda pauses, error=None: 0.01)


@pytest.fixture
def script() -> Iterator[Script]:
    with serving() as script:
        yield script


@pytest.fixture
def connection(script: Script) -> Iterator[PendingConnection]:
    """One that has been answered before."""
    made = PendingConnection(script.url)
    script.answers += [SEEN]
    made.send("POST", "/", "token", {})
    made.receive()
    yield made
    made.close()


def test_a_request_is_sent_again_until_the_service_is_back(script: Script, connection: PendingConnection) -> None:
    script.answers += [*AWAY, BUSY, BROKEN, SEEN]
    connection.send("POST", "/v1/seats/s-1/step", "token", {"tick": 7})
    assert connection.receive() == {"tick": 1}
    assert script.asked[1:] == [("POST /v1/seats/s-1/step", "")] * (len(AWAY) + 3)
    assert len(set(script.bodies[1:])) == 1


@pytest.mark.parametrize("answer", AWAY)
def test_patience_with_a_service_that_stays_away_ends(
    script: Script, connection: PendingConnection, answer: Answer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pending, "AWAY_S", 0.0)
    script.answers += [BUSY, answer]
    connection.send("GET", "/", "token")
    with pytest.raises((UnreachableError, WireError)):
        connection.receive()


def test_a_refusal_for_good_is_told_at_once(script: Script, connection: PendingConnection) -> None:
    script.answers += [Answer({"detail": "seat lost"}, 410)]
    connection.send("GET", "/", "token")
    with pytest.raises(WireError, match="seat lost"):
        connection.receive()


def test_an_address_that_never_answered_is_told_at_once(script: Script) -> None:
    connection = PendingConnection(script.url)
    for answer in AWAY:
        script.answers += [answer]
        connection.send("GET", "/", "token")
        with pytest.raises((UnreachableError, WireError)):
            connection.receive()
    connection.close()


def test_an_order_of_a_world_that_is_sent_again_makes_one(script: Script) -> None:
    plan = RemoteWorlds(script.url, "token", {}, None, ("speedometer",), "target_speed_steering")
    world = RemoteWorld(plan, Dict({"speedometer": Box(0.0, 1.0, (2,))}), Box(0.0, 1.0, (2,)))
    script.answers += [BUSY, Answer({"id": "wo-1", "egos": [{"name": "ego"}]}, 201)]
    script.answers += [Answer({"seat": "s-1", "token": "t"}, 201), Answer({}), Answer({})]
    script.answers += [Answer({"tick": 0, "observations": {}})]
    world.begin_reset(0)
    world.reset(seed=0)
    first, again, *others = script.keys
    assert first == again != ""
    assert set(others) == {""}
    assert [path for path, _ in script.asked[:2]] == ["POST /v1/worlds"] * 2
    script.answers += [Answer({}), Answer({})]
    world.close()


def test_an_environment_tells_once_why_it_has_no_world(script: Script, caplog: pytest.LogCaptureFixture) -> None:
    full = Answer({"detail": "expected at most 2 live worlds of one owner; end one"}, 429, {"retry-after": "0"})
    plan = RemoteWorlds(script.url, "token", {}, None, ("speedometer",), "target_speed_steering", rows=2)
    world = RemoteWorld(plan, Dict({"speedometer": Box(0.0, 1.0, (2,))}), Box(0.0, 1.0, (2,)))
    script.answers += [full, full, Answer({"detail": "no such benchmark"}, 422)]
    world.begin_reset(0)
    with pytest.raises(InvalidInputError, match="no such benchmark"):
        world.reset(seed=0)
    assert [one.getMessage() for one in caplog.records] == [
        "waits for a world: expected at most 2 live worlds of one owner; end one (HTTP 429)"
    ]
    world.close()


def test_an_environment_that_closes_is_not_kept_by_a_service_that_is_away(
    script: Script, connection: PendingConnection
) -> None:
    script.answers += [AWAY[0]]
    connection.send("POST", "/v1/worlds/wo-1/end", "token", {})
    with pytest.raises(WireError, match="500"):
        connection.receive(patience_s=0.0)
