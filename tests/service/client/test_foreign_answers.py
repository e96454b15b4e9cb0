"""What answers at an address and is no dohyo service is told in one line; a proxy's page passes by itself."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from dohyo.evaluation.agent import AgentSpec
from dohyo.evaluation.records.record import AgentInfo
from dohyo.service.cli.commands import worker as command
from dohyo.service.client import client as blocking_client
from dohyo.service.client.client import Client
from dohyo.service.client.connection import Pauses, UnreachableError, WireError
from dohyo.service.client.errors import ServiceError
from dohyo.service.client.pending import PendingConnection
from dohyo.service.client.worker_session import WorkerSession
from tests.service.client.scripted import Answer, Script, serving
from tests.service.serving import command as run_command

PAGE = Answer("<html>moved</html>", headers={"content-type": "text/html; charset=utf-8"})
OTHER = Answer({"hello": 1})
MOVED = Answer("<html></html>", 308, {"content-type": "text/html", "location": "https://example.org/v1"})
BROKEN_JSON = Answer("{", headers={"content-type": "application/json"})
FOREIGN = {
    "it sent text/html": PAGE,
    "it sent JSON without '": OTHER,
    "it sent a redirection to https://example.org/v1": MOVED,
    "that cannot be read": BROKEN_JSON,
}
WORLD = Answer({"id": "wo-1", "status": "waiting"}, headers={"content-type": "Application/JSON;charset=utf-8"})


@pytest.fixture(autouse=True)
def _soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Pauses, "next", lambda pauses, error=None: 0.01)
    monkeypatch.setattr(blocking_client, "POLL_S", 0.01)


@pytest.fixture
def script() -> Iterator[Script]:
    with serving() as script:
        yield script


@pytest.mark.parametrize(("told", "answer"), FOREIGN.items())
def test_commands_tell_in_one_line_what_answers_there(told: str, answer: Answer, script: Script) -> None:
    for arguments in (["evaluations", "list"], ["leaderboard", "quickstart"], ["evaluations", "watch", "ev-1"]):
        script.answers = [answer, answer]  # a stream is asked for first
        done = run_command(*arguments, "--server", script.url, "--token", "secret")
        script.answers = []
        assert isinstance(done.exception, ServiceError), arguments
        assert told.partition(" that")[0] in str(done.exception)
        assert str(done.exception).startswith(f"no dohyo service answers at {script.url}: it sent ")
        assert "\n" not in str(done.exception)


@pytest.mark.parametrize(("told", "answer"), FOREIGN.items())
def test_workers_tell_it_too(told: str, answer: Answer, script: Script) -> None:
    script.answers = [answer]
    with pytest.raises((WireError, UnreachableError), match=f"no dohyo service answers at .*{told}"):
        WorkerSession(script.url, "token", "mine").acquire()
    script.answers = [answer, answer]  # the agent, and its versions
    info = AgentInfo(kind="remote", entry="remote:mine", **AgentSpec(name="mine").model_dump())
    with pytest.raises(ServiceError, match="no dohyo service answers at"):
        command._declare(script.url, "token", "mine", info)
    script.answers = []


def test_parameters_of_a_content_type_are_no_matter(script: Script) -> None:
    script.answers = [WORLD, WORLD]
    with Client(script.url) as client:
        assert client.world("wo-1")["id"] == "wo-1"
    connection = PendingConnection(script.url)
    connection.send("GET", "/v1/worlds/wo-1", "token")
    assert connection.receive()["id"] == "wo-1"
    connection.close()


def test_a_page_of_a_proxy_passes_once_a_service_has_answered(script: Script) -> None:
    script.answers = [WORLD, PAGE, WORLD, PAGE]
    with Client(script.url) as client:
        client.world("wo-1")
        assert client.world("wo-1")["status"] == "waiting"
        with pytest.raises(ServiceError, match="it sent text/html"):
            client.resume_world("wo-1")  # an order is not repeated
    script.answers = [WORLD, PAGE, WORLD]
    connection = PendingConnection(script.url)
    for _ in range(2):
        connection.send("GET", "/v1/worlds/wo-1", "token")
        assert connection.receive()["id"] == "wo-1"
    connection.close()
