"""A server that attacks the machines of its clients, asked by the real command."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.evaluation.records.record import EpisodeRecord
from dohyo.evaluation.records.signature import public_key
from dohyo.evaluation.records.store import seal, write_record
from dohyo.evaluation.running.manifest import Manifest
from dohyo.service.client import downloads
from dohyo.service.client.client import Client
from dohyo.sumo_networks.errors import InvalidInputError
from tests.evaluation.builders import AGENT, drive
from tests.forked import Python
from tests.service.cli.test_hostile_records import dohyo, info, record_of


class Hostile:
    """Answers of a server, by path."""

    def __init__(self, record: EpisodeRecord, folder: Path) -> None:
        path = write_record(folder, "served", record, drive())
        benchmark = load_benchmark("quickstart")
        manifest = Manifest(agent=AGENT, benchmark=benchmark, benchmark_sha256=benchmark.sha256)
        self.evaluation: dict[str, Any] = {"id": "ev-1", "benchmark": "quickstart", "agent": "pilot", "version": 1}
        self.episode: dict[str, Any] = {
            "id": "ep-1",
            "scenario": record.scenario.name,
            "seed": record.scenario.seed,
            "record_hash": record.record_hash,
        }
        self.manifest = json.loads(manifest.model_dump_json())
        self.content = path.read_bytes()
        self.table = path.with_suffix(".parquet").read_bytes()
        self.headers: dict[str, str] = {}

    def answer(self, path: str) -> bytes:
        documents = {
            "/v1/evaluations/ev-1": self.evaluation,
            "/v1/evaluations/ev-1/episodes": {"items": [self.episode], "next": None},
            "/v1/evaluations/ev-1/manifest": self.manifest,
        }
        if path.endswith("/record"):
            return self.content
        return self.table if path.endswith("/trajectory") else json.dumps(documents[path.partition("?")[0]]).encode()


class Handler(BaseHTTPRequestHandler):
    """Answers as it is told."""

    def __init__(self, hostile: Hostile, *arguments: Any) -> None:
        self.hostile = hostile
        super().__init__(*arguments)

    def do_GET(self) -> None:
        content = self.hostile.answer(self.path)
        self.send_response(200)
        for name, value in self.hostile.headers.items():
            self.send_header(name, value)
        self.send_header("content-length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, *_: Any) -> None:
        """Silent."""


@pytest.fixture
def hostile(tmp_path: Path) -> Hostile:
    """Serves a record that names a program as its agent."""
    marker = tmp_path / "ran"
    popen = info("subprocess:Popen", settings={"args": ["touch", str(marker)]})
    named = {"benchmark": ("quickstart", load_benchmark("quickstart").sha256)}
    return Hostile(seal(record_of(popen).model_copy(update=named)), tmp_path / "server")


@pytest.fixture
def url(hostile: Hostile) -> Iterator[str]:
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Handler, hostile))
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()
    thread.join()
    server.server_close()


def fetch(url: str, tmp_path: Path, *options: str) -> Python:
    here = tmp_path / "here"
    here.mkdir(exist_ok=True)
    return dohyo("evaluations", "fetch", "ev-1", "--server", url, *options, cwd=here)


def files(tmp_path: Path) -> set[str]:
    return {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if path.is_file()}


def test_what_was_fetched_runs_nothing(hostile: Hostile, url: str, tmp_path: Path) -> None:
    before = files(tmp_path)
    fetched = fetch(url, tmp_path)
    assert fetched.returncode == 0, fetched.errors()
    new = files(tmp_path) - before
    stem = f"here/out/quickstart/pilot-v1/records/{hostile.episode['scenario']}-s0"
    assert new == {f"{stem}.json", f"{stem}.parquet", "here/out/quickstart/pilot-v1/evaluation.json"}
    record = str(tmp_path / f"{stem}.json")
    for command in (("verify", record), ("explain", record, "--time", "1")):
        result = dohyo(*command, cwd=tmp_path / "here")
        assert (result.returncode, "no installed package registers" in result.errors()) == (2, True)
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize(
    ("which", "name", "value"),
    [("evaluation", "benchmark", "../../escaped"), ("episode", "scenario", "../../../../escaped")],
)
def test_names_of_a_server_are_no_paths(
    hostile: Hostile, url: str, tmp_path: Path, which: str, name: str, value: str
) -> None:
    before = files(tmp_path)
    getattr(hostile, which)[name] = value
    refused = fetch(url, tmp_path)
    assert refused.returncode == 2
    assert "to be a file name" in refused.errors()
    assert len(refused.errors().strip().splitlines()) == 1
    assert files(tmp_path) == before


@pytest.mark.parametrize("name", ["/etc/x", "../x", "a/b", "a\\b", "a\nb", ".x", "x" * 300, "a\0b", "ü"])
def test_names_that_are_refused(hostile: Hostile, url: str, tmp_path: Path, name: str) -> None:
    hostile.episode["scenario"] = name
    with Client(url) as client, pytest.raises(InvalidInputError, match="file name"):
        client.download("ev-1", tmp_path / "records")
    assert not list((tmp_path / "records").iterdir())


def test_another_episodes_record_is_refused(hostile: Hostile, url: str, tmp_path: Path) -> None:
    hostile.episode["record_hash"] = "0" * 64
    with Client(url) as client, pytest.raises(InvalidInputError, match="another episode's"):
        client.download("ev-1", tmp_path / "records")
    assert not list((tmp_path / "records").glob("*.json"))


def test_an_answer_without_end_is_cut(
    hostile: Hostile, url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(downloads, "FACTS_LIMIT_BYTES", 1_000_000)
    hostile.content = b" " * 2_000_000
    with Client(url) as client, pytest.raises(InvalidInputError, match="at most 1 MB"):
        client.download("ev-1", tmp_path / "records")


def test_a_signature_of_something_else_is_refused(hostile: Hostile, url: str, tmp_path: Path) -> None:
    key = public_key(Ed25519PrivateKey.generate())
    for value, why in (("Ed25519 a b", "expected 'dohyo-signature"), (f"Ed25519 {key} {'A' * 86}==", "not made")):
        hostile.headers["dohyo-signature"] = value
        with Client(url) as client, pytest.raises(InvalidInputError, match=why):
            client.download("ev-1", tmp_path / "records")


def test_a_manifest_of_another_shape_is_refused(hostile: Hostile, url: str, tmp_path: Path) -> None:
    hostile.manifest["benchmark_sha256"] = "0" * 64
    refused = fetch(url, tmp_path)
    assert (refused.returncode, "manifest" in refused.errors()) == (2, True)
