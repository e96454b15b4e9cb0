"""TLS: the service with a certificate of its own making, and webhooks to receivers that have one."""

from __future__ import annotations

import ssl
import subprocess
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path
from urllib.parse import urlsplit

import httpx
import pytest

from dohyo.service.client.client import Client
from dohyo.service.client.errors import ServiceError
from dohyo.service.client.worker_session import WorkerSession
from dohyo.service.evaluations.model import EpisodeStatus, EvaluationStatus
from dohyo.service.server import check_exposure
from dohyo.service.settings import Settings
from dohyo.service.webhooks import delivery
from dohyo.service.webhooks import queries as webhooks
from dohyo.sumo_networks.errors import InvalidInputError
from tests.service import certificates
from tests.service.harness import finish, running
from tests.service.serving import command as run_here
from tests.service.serving import run, serving
from tests.service.webhooks.receiver import Receiver, settled


@pytest.fixture
def receiver(certified: tuple[Path, Path]) -> Iterator[Receiver]:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(*certified)
    made = Receiver(context)
    yield made
    made.close()


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory, certified: tuple[Path, Path]) -> dict[str, Path]:
    """Files that go together, and files that do not."""
    folder = tmp_path_factory.mktemp("mistakes")
    certificate, key = certified
    encrypted, empty = folder / "encrypted.pem", folder / "empty.pem"
    command = ["openssl", "pkcs8", "-topk8", "-in", str(key), "-out", str(encrypted), "-passout", "pass:hunter2"]
    subprocess.run(command, check=True, capture_output=True)
    empty.touch()
    other = certificates.make(folder / "other")[1]
    return {"certificate": certificate, "key": key, "encrypted": encrypted, "empty": empty, "other": other}


@pytest.mark.parametrize(
    ("certificate", "key", "says"),
    [
        ("key", "certificate", "expected PEM files of a certificate and of its key"),
        ("empty", "empty", "expected PEM files"),
        ("certificate", "empty", "expected PEM files"),
        ("certificate", "other", "the key is of another certificate"),
        ("certificate", "encrypted", "the key is encrypted"),
    ],
)
def test_files_that_cannot_be_used_are_one_line_before_anything_is_made(
    tmp_path: Path, files: dict[str, Path], certificate: str, key: str, says: str
) -> None:
    """Before, they were tracebacks after the administrator's token, which is shown once."""
    data = tmp_path / "data"
    tls = ("--tls-certificate", str(files[certificate]), "--tls-key", str(files[key]))
    done = run_here("serve", "--port", "0", "--data", str(data), *tls)
    assert isinstance(done.exception, InvalidInputError)
    assert says in str(done.exception)
    assert not data.exists()


def test_authorities_of_webhooks_are_certificates(files: dict[str, Path]) -> None:
    check_exposure(Settings(webhook_authorities=files["certificate"]))
    for one in ("key", "empty"):
        with pytest.raises(InvalidInputError, match="expected a PEM file of certificates"):
            check_exposure(Settings(webhook_authorities=files[one]))


@pytest.mark.slow
def test_client_worker_and_command_line_speak_to_a_service_whose_certificate_they_trust(
    tmp_path: Path, certified: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    certificate, key = certified
    tls = ("--tls-certificate", str(certificate), "--tls-key", str(key))
    with serving(tmp_path / "data", "--host", "localhost", *tls, certificate=certificate) as served:
        port = urlsplit(served.url).port
        url = served.url
        assert url == f"https://localhost:{port}"
        with Client(url, served.token) as stranger, pytest.raises(ServiceError, match="CERTIFICATE_VERIFY_FAILED"):
            stranger.get("/v1/me")
        monkeypatch.setenv("SSL_CERT_FILE", str(certificate))
        with Client(url, served.token) as client:
            assert client.get("/v1/me")["role"] == "admin"
            client.register_agent("remote")
        done = run("submit", "remote", "--remote", "--server", url, "--token", served.token)
        assert done.returncode == 0, done.stderr
        with WorkerSession(url, served.token, "remote") as session:
            assert session.acquire(0.0) is None
        trusting = ssl.create_default_context(cafile=certificate)
        assert "max-age" in httpx.get(url, verify=trusting, timeout=120).headers["strict-transport-security"]
        with pytest.raises(httpx.TransportError):
            httpx.get(f"http://localhost:{port}/v1/me", timeout=5)
        assert served.end() == 0


@pytest.mark.parametrize("trusted", [True, False])
def test_a_webhook_over_https_goes_to_whom_it_can_trust_alone(
    tmp_path: Path,
    certified: tuple[Path, Path],
    receiver: Receiver,
    monkeypatch: pytest.MonkeyPatch,
    trusted: bool,
) -> None:
    monkeypatch.setattr(delivery, "POLL_S", 0.02)
    monkeypatch.setattr(webhooks, "FIRST_WAIT", timedelta(seconds=0.001))
    monkeypatch.setattr(webhooks, "ATTEMPTS", 8)
    authorities = certified[0] if trusted else None
    with running(tmp_path / "data", webhook_private_addresses=True, webhook_authorities=authorities) as service:
        team = service.caller("team")
        team.post("/v1/webhooks", {"url": f"https://localhost:{receiver.port}/hook"})
        team.agent("a")
        evaluation = team.evaluation("a")
        finish(service.services.database, evaluation, EvaluationStatus.DONE, EpisodeStatus.DONE)
        (told,) = settled(service)
    assert (told.delivered is not None) is trusted
    assert [headers["host"] for headers, _ in receiver.got] == ([f"localhost:{receiver.port}"] if trusted else [])
    assert told.failure == (None if trusted else "ConnectError")
