"""TLS: the service with a certificate of its own making, and webhooks to receivers that have one."""

from __future__ import annotations

import shutil
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
from dohyo.service.webhooks import delivery
from dohyo.service.webhooks import queries as webhooks
from tests.service.harness import finish, running
from tests.service.serving import run, serving
from tests.service.webhooks.receiver import Receiver, settled


@pytest.fixture(scope="module")
def certified(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A self-signed certificate of this machine, and its key."""
    if shutil.which("openssl") is None:
        pytest.skip("no openssl on this machine to make a certificate with")
    folder = tmp_path_factory.mktemp("tls")
    certificate, key = folder / "certificate.pem", folder / "key.pem"
    command = ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes"]
    command += ["-keyout", str(key), "-out", str(certificate), "-days", "2", "-subj", "/CN=localhost"]
    command += ["-addext", "subjectAltName=DNS:localhost,IP:127.0.0.1"]
    subprocess.run(command, check=True, capture_output=True)
    return certificate, key


@pytest.fixture
def receiver(certified: tuple[Path, Path]) -> Iterator[Receiver]:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(*certified)
    made = Receiver(context)
    yield made
    made.close()


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
