"""Which torch `make setup` takes: decided by a GPU, and by whether an index answers."""

from __future__ import annotations

import importlib.util
import socket
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from types import ModuleType

import pytest

FILE = Path(__file__).parents[1] / ".ci" / "install.py"


@pytest.fixture
def install(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The script, on a machine without a GPU."""
    spec = importlib.util.spec_from_file_location("install", FILE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setattr(module, "has_gpu", lambda: False)
    monkeypatch.setattr(module, "ANSWER_WITHIN_S", 2.0)
    return module


class Index(BaseHTTPRequestHandler):
    def do_GET(self) -> None:
        self.send_response(200 if self.path == "/whl/cpu/torch/" else 404)
        self.end_headers()

    def log_message(self, *_: object) -> None: ...


@pytest.fixture
def index() -> Iterator[str]:
    server = ThreadingHTTPServer(("127.0.0.1", 0), Index)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}/whl"
    server.shutdown()
    server.server_close()


def test_torch_for_cpus_comes_from_an_index_that_answers(install: ModuleType, index: str) -> None:
    given = {"PIP_EXTRA_INDEX_URL": "http://mine", "PIP_FIND_LINKS": "/wheels"}
    environment, told = install.plan(given, f"{index}/cpu")
    assert environment == {**given, "PIP_EXTRA_INDEX_URL": f"http://mine {index}/cpu"}
    assert "torch for CPUs" in told
    assert install.plan(environment, f"{index}/cpu")[0] == environment  # no index twice


def test_an_index_without_torch_is_left_out(install: ModuleType, index: str) -> None:
    environment, told = install.plan({"PIP_FIND_LINKS": "/wheels"}, f"{index}/other")
    assert environment == {"PIP_FIND_LINKS": "/wheels"}
    assert "no answer" in told


def test_without_a_network_pip_decides(install: ModuleType) -> None:
    assert install.plan({}, "http://127.0.0.1:9/whl/cpu")[0] == {}
    assert install.plan({}, "http://no-such-host.invalid/whl/cpu")[0] == {}


def test_a_server_that_hangs_counts_as_none(install: ModuleType) -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:
        assert not install.answers(f"http://127.0.0.1:{silent.getsockname()[1]}/whl/cpu", within_s=0.5)


def test_with_a_gpu_pip_decides(install: ModuleType, index: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(install, "has_gpu", lambda: True)
    environment, told = install.plan({}, f"{index}/cpu")
    assert environment == {}
    assert "for the GPU" in told
