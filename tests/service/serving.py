"""`dohyo serve` and other commands, as users start them: in processes of their own."""

from __future__ import annotations

import json
import logging
import os
import re
import signal
import ssl
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
from typer.testing import CliRunner

from dohyo.service.cli.main import app
from tests.forked import MAIN, Python, dohyo
from tests.service.harness import patiently

START_S = 300.0


class Served:
    """`dohyo serve` in a process of its own.

    Attributes:
        url: Where it listens.
        printed: Lines on standard output.
        log: Lines on standard error, parsed.
    """

    def __init__(self, data: Path, *options: str, before: str = "", certificate: Path | None = None) -> None:
        """Starts it and waits until it is ready.

        Args:
            data: Its folder.
            options: Of the command.
            before: Python to run first, in its process.
            certificate: To trust it by, where it speaks TLS.
        """
        self._verify = ssl.create_default_context(cafile=certificate) if certificate else True
        environment = {key: value for key, value in os.environ.items() if not key.startswith("DOHYO_")}
        serve = ["serve", "--port", "0", "--data", str(data), "--processes", "1", *options]
        self.process = Python(f"{before}\n{MAIN}", *serve, env=environment, piped=True)
        out, err = self.process.streams
        self.printed: list[str] = []
        self.log: list[dict[str, Any]] = []
        self._readers = [
            threading.Thread(target=self._read, args=(out, self.printed.append)),
            threading.Thread(target=self._read, args=(err, self._note)),
        ]
        for reader in self._readers:
            reader.start()
        self.url = self._ready()

    @staticmethod
    def _read(stream: Any, take: Any) -> None:
        for line in stream:
            take(line.rstrip("\n"))

    def _note(self, line: str) -> None:
        try:
            self.log.append(json.loads(line))
        except ValueError:
            self.log.append({"level": "text", "message": line})  # what a library or a process of an episode wrote

    def _ready(self) -> str:
        deadline = time.monotonic() + START_S
        while time.monotonic() < deadline:
            assert self.process.poll() is None, (self.printed, self.log)
            if self.printed:
                url = self.printed[0].removeprefix("dohyo: ")
                try:
                    if httpx.get(f"{url}/health/ready", timeout=10, verify=self._verify).status_code == 200:
                        return url
                except httpx.TransportError:
                    pass
            time.sleep(0.1)
        raise AssertionError(f"not ready: {self.printed} {self.log}")

    @property
    def token(self) -> str:
        """The administrator's."""
        (found,) = (match[1] for line in self.printed if (match := re.search(r"(dohyo_\S+)", line)))
        return found

    def ask(self, method: str, path: str, json: Any = None) -> Any:
        """What the administrator is answered."""

        def send(prefer: dict[str, str]) -> httpx.Response:
            headers = {"authorization": f"Bearer {self.token}"} | prefer
            return httpx.request(method, self.url + path, json=json, headers=headers, timeout=120, verify=self._verify)

        answer = patiently(send) if method == "POST" else send({})
        assert answer.status_code < 300, (answer.text, self.log)
        return answer.json()

    def end(self, with_signal: int = signal.SIGTERM) -> int:
        """Its exit code."""
        self.process.send_signal(with_signal)
        return self.ended()

    def ended(self) -> int:
        """The same of a process that was told to end."""
        code = self.process.wait()
        for reader in self._readers:
            reader.join(60)
        return code


@contextmanager
def serving(data: Path, *options: str, before: str = "", certificate: Path | None = None) -> Iterator[Served]:
    """A running service, gone at the end of the block."""
    served = Served(data, *options, before=before, certificate=certificate)
    try:
        yield served
    finally:
        if served.process.poll() is None:
            served.process.end(signal.SIGKILL)


def run(*arguments: str, patience_s: float = 300) -> subprocess.CompletedProcess[str]:
    """A command in a process of its own."""
    process = dohyo(*arguments)
    code = process.end(timeout=patience_s)
    return subprocess.CompletedProcess(arguments, code, process.output(), process.errors())


def command(*arguments: str) -> Any:
    """The same in this process, which is faster."""
    root = logging.getLogger()
    handlers, level = root.handlers, root.level
    try:
        return CliRunner().invoke(app, arguments)
    finally:
        # `serve` logs to the runner's stderr, which is closed now.
        root.handlers, root.level = handlers, level
