"""Every operation of the published interface, under requests that are made up: no 5xx, and nothing undocumented."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest
import schemathesis
import uvicorn
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from schemathesis import GenerationMode

from dohyo.service.accounts.model import Role
from dohyo.service.app import create_app
from dohyo.service.settings import Settings
from tests.service.harness import Harness, IdleScheduler

EXAMPLES = 8
# A trial makes a child process; the wire waits for workers and has tests of its own.
SLOW = ("/v1/workers/{worker_id}/acquire", "/v1/evaluations/{identifier}/progress")


@contextmanager
def _listening(data: Path) -> Iterator[tuple[str, Harness]]:
    """The service behind a real socket, since some requests that are made up exist only there."""
    app = create_app(Settings(data=data, requests_per_minute=1_000_000, _env_file=None), IdleScheduler)
    server = uvicorn.Server(uvicorn.Config(app, port=0, log_config=None, access_log=False, lifespan="on"))
    thread = threading.Thread(target=server.run)
    thread.start()
    while not server.started:
        assert thread.is_alive()
        time.sleep(0.01)
    url = f"http://127.0.0.1:{server.servers[0].sockets[0].getsockname()[1]}"
    try:
        with httpx.Client(base_url=url) as client:
            yield url, Harness(client, app.state.services)  # type: ignore[arg-type]
    finally:
        server.should_exit = True
        thread.join()


@pytest.mark.slow
def test_no_request_finds_an_undocumented_answer(tmp_path: Path) -> None:
    with _listening(tmp_path / "data") as (url, service):
        admin = service.caller("root", Role.ADMIN)
        admin.agent("team-blue-mpc")
        evaluation = admin.evaluation("team-blue-mpc", seeds=[0])
        episode = admin.get(f"/v1/evaluations/{evaluation}/episodes").json()["items"][0]["id"]
        real = {"evaluations": {"identifier": evaluation}, "episodes": {"identifier": episode}}
        real |= {"networks": {"name": "ingolstadt"}, "agents": {"name": "team-blue-mpc"}}
        schema = schemathesis.openapi.from_dict(service.client.get("/openapi.json").json())
        operations = [operation.ok() for operation in schema.get_all_operations()]
        assert len(operations) > 30
        faults: list[str] = []
        for operation in operations:
            if operation.path not in SLOW:
                _try(url, operation, admin.headers, real, faults)
    assert sorted(set(faults)) == []


def _try(url: str, operation: Any, headers: dict[str, str], real: dict[str, dict[str, str]], faults: list[str]) -> None:
    kind = operation.path.split("/")[2] if operation.path.count("/") > 2 else ""
    documented = {str(status) for status in operation.definition.raw["responses"]}

    @settings(
        max_examples=EXAMPLES,
        deadline=None,
        database=None,
        derandomize=True,
        phases=[Phase.explicit, Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(
        case=st.one_of(*(operation.as_strategy(generation_mode=mode) for mode in GenerationMode)), exists=st.booleans()
    )
    def probe(case: Any, exists: bool) -> None:
        if exists and case.path_parameters and kind in real:
            case.path_parameters.update(real[kind])
        answer = case.call(base_url=url, headers=headers)
        where = f"{operation.method.upper()} {operation.path}: {answer.status_code}"
        if answer.status_code >= 500 and answer.status_code not in (503, 507):
            faults.append(f"{where} {answer.text[:300]}")
        elif str(answer.status_code) not in documented:
            faults.append(f"{where} is not documented")
        elif (
            answer.status_code >= 400
            and answer.status_code != 416
            and answer.headers.get("content-type") != ["application/problem+json"]
        ):
            faults.append(f"{where} is no problem document: {answer.headers.get('content-type')}")

    probe()


def test_every_operation_is_described(service: Harness) -> None:
    document = service.client.get("/openapi.json").json()
    tags = {tag["name"] for tag in document["tags"]}
    for path, operations in document["paths"].items():
        for method, operation in operations.items():
            where = f"{method.upper()} {path}"
            assert operation.get("description"), where
            assert set(operation["tags"]) <= tags, where
            assert {"401", "422", "429", "503"} <= set(operation["responses"]), where
            for status, response in operation["responses"].items():
                if status >= "400" and status != "416":
                    assert list(response["content"]) == ["application/problem+json"], (where, status)


def test_bodies_have_examples_that_are_taken_for_what_they_are(service: Harness) -> None:
    document = service.client.get("/openapi.json").json()
    for name in ("TokenOrder", "AgentOrder", "BuiltinOrder", "RemoteOrder", "EvaluationOrder", "WebhookOrder"):
        assert document["components"]["schemas"][name]["examples"], name
