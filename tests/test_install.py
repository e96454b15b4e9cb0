"""Which torch `make setup` takes, decided by a GPU and by whether an index answers; and which extras, and when."""

from __future__ import annotations

import importlib.util
import os
import shutil
import socket
import subprocess
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[1]
FILE = ROOT / ".ci" / "install.py"
# A Python that notes what it is to install, and does nothing.
PYTHON = """#!/bin/sh
case "$1" in .ci/install.py) shift; echo "$@" >>installed;; esac
"""


@pytest.fixture
def install(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The script, on a machine without a GPU."""
    spec = importlib.util.spec_from_file_location("install", FILE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setattr(module, "has_gpu", lambda: False)
    monkeypatch.setattr(module.answers, "__defaults__", (2.0,))
    return module


class Index(BaseHTTPRequestHandler):
    def do_GET(self) -> None:
        self.send_response(200 if self.path == "/whl/cpu/torch/" else 404)
        self.end_headers()

    def log_message(self, *_: object) -> None: ...


@pytest.fixture
def index(install: ModuleType, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """An index that answers; a slow machine has time for it."""
    monkeypatch.setattr(install.answers, "__defaults__", (60.0,))
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


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A checkout whose Python installs nothing."""
    python = tmp_path / ".venv" / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.write_text(PYTHON)
    python.chmod(0o755)
    shutil.copy(ROOT / "Makefile", tmp_path)
    (tmp_path / "pyproject.toml").touch()
    os.utime(tmp_path / "pyproject.toml", (0, 0))
    return tmp_path


def set_up(checkout: Path, *variables: str) -> list[str]:
    """What `make setup` installs, a line for each time."""
    (checkout / "installed").write_text("")
    environment = {key: value for key, value in os.environ.items() if not key.startswith("MAKE") and key != "EXTRAS"}
    command = ["make", "setup", "PYTHON=.venv/bin/python", *variables]
    subprocess.run(command, cwd=checkout, env=environment, check=True)
    return (checkout / "installed").read_text().splitlines()


def test_further_extras_are_installed_once_beside_those_that_are_there(checkout: Path) -> None:
    assert set_up(checkout) == ["dev"]
    assert set_up(checkout) == []
    assert set_up(checkout, "EXTRAS=dev cluster") == ["cluster dev"]
    assert set_up(checkout, "EXTRAS=dev cluster") == []
    assert set_up(checkout) == []
    (checkout / "pyproject.toml").touch()
    os.utime(checkout / ".venv/.packages", (0, 0))
    assert set_up(checkout) == ["cluster dev"]


def test_a_checkout_of_an_older_makefile_is_not_installed_again(checkout: Path) -> None:
    (checkout / ".venv/.packages").touch()
    assert set_up(checkout) == []
    assert set_up(checkout, "EXTRAS=dev cluster") == ["cluster dev"]
