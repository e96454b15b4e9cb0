"""Sixty uploads at once, against a service in its own process: a few are checked, the rest is refused, others go on.

Uploads that never end are few, too.
"""

from __future__ import annotations

import json
import selectors
import socket
import subprocess
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx
import pytest

from dohyo.service.accounts.model import Role
from dohyo.service.accounts.queries import create_token
from tests.service.policies.models import identity
from tests.service.served import Service, wait_until

SPEC = json.dumps({"track": "map", "sensors": ["speedometer"], "control": "target_speed_steering"})
AT_ONCE, EACH = 2, 3
MOST_PROCESSES = 2 * AT_ONCE  # a check has one confined process at a time, and one that is ending


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    shared = Service(tmp_path_factory.mktemp("data"), jobs=AT_ONCE, jobs_per_owner=EACH, requests_per_minute=100_000)
    shared.start()
    yield shared
    shared.close()


def caller(service: Service, owner: str) -> httpx.Client:
    with service.database.session() as session:
        secret = create_token(session, owner, Role.SUBMITTER)[1]
    limits = httpx.Limits(max_connections=100)
    return httpx.Client(
        base_url=service.url, headers={"authorization": f"Bearer {secret}"}, timeout=120.0, limits=limits
    )


def children(service: Service) -> int:
    assert service.process is not None
    found = subprocess.run(["pgrep", "-P", str(service.process.pid)], capture_output=True, text=True, check=False)
    return len(found.stdout.split())


def test_sixty_uploads_at_once_are_bounded_and_keep_nobody_waiting(service: Service) -> None:
    content = identity().SerializeToString()
    hogs, other = [caller(service, "blue"), caller(service, "red")], caller(service, "newcomer")
    for hog, agent in zip(hogs, ("b", "r"), strict=True):
        assert hog.post("/v1/agents", json={"name": agent}).status_code == 201
    quiet = children(service)

    def upload(number: int) -> httpx.Response:
        files = {"spec": (None, SPEC), "file": ("policy.onnx", content)}
        return hogs[number % 2].post(f"/v1/agents/{'br'[number % 2]}/submissions/onnx", files=files)

    most, answered = 0, 0
    with ThreadPoolExecutor(60) as threads:
        sent = [threads.submit(upload, number) for number in range(60)]
        while not all(one.done() for one in sent):
            assert other.get("/v1/me").json()["owner"] == "newcomer"
            assert other.get("/health/ready").status_code == 200
            most, answered = max(most, children(service) - quiet), answered + 1
    answers = [one.result() for one in sent]
    statuses = Counter(answer.status_code for answer in answers)
    assert set(statuses) == {202, 429}, statuses
    assert statuses[202] >= 2 * EACH
    assert all(int(one.headers["retry-after"]) > 0 for one in answers if one.status_code == 429)
    jobs = [(hogs[number % 2], one.headers["location"]) for number, one in enumerate(answers) if one.status_code == 202]

    def ended() -> bool:
        nonlocal most
        most = max(most, children(service) - quiet)
        return all(hog.get(job).json()["status"] == "done" for hog, job in jobs)

    wait_until(ended, "the checks do not end")
    assert 0 < most <= MOST_PROCESSES
    assert answered > 0
    assert not list(Path(service.settings.uploads).iterdir())
    assert len(list(service.settings.policies.glob("*.onnx"))) == 1


def begin_upload(service: Service, agent: str, authorization: str) -> socket.socket:
    """An upload whose file does not end."""
    one = socket.create_connection(("127.0.0.1", service.port), timeout=60)
    part = b'--b\r\ncontent-disposition: form-data; name="file"; filename="x.onnx"\r\n\r\n' + bytes(1_000_000)
    head = f"POST /v1/agents/{agent}/submissions/onnx HTTP/1.1\r\nhost: x\r\nauthorization: {authorization}\r\n"
    about = "content-type: multipart/form-data; boundary=b\r\ncontent-length: 10000000\r\n\r\n"
    one.sendall((head + about).encode() + part)
    return one


def test_an_owner_has_few_uploads_under_way(service: Service) -> None:
    greedy, other = caller(service, "greedy"), caller(service, "modest")
    files = {"spec": (None, SPEC), "file": ("policy.onnx", identity().SerializeToString())}
    for client, agent in ((greedy, "g"), (other, "m")):
        assert client.post("/v1/agents", json={"name": agent}).status_code == 201
    begun = [begin_upload(service, "g", greedy.headers["authorization"]) for _ in range(8)]
    with selectors.DefaultSelector() as selector:
        for one in begun:
            selector.register(one, selectors.EVENT_READ)
        wait_until(lambda: len(selector.select(0)) == 4, "not all but four are refused")
        answers = [one.fileobj.recv(10_000) for one, _ in selector.select(0)]  # type: ignore[union-attr]
    assert all(b" 429 " in one and b"at most 4 uploads at once" in one for one in answers), answers
    assert other.post("/v1/agents/m/submissions/onnx", files=files).status_code == 202
    for one in begun:
        one.close()
    wait_until(lambda: greedy.post("/v1/agents/g/submissions/onnx", files=files).status_code == 202, "they never end")
