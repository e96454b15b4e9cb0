"""ForkServer: starts processes as copies of one that has loaded their libraries.

A new interpreter needs more than a second of processor time before it can drive; a copy needs some milliseconds. The
server is a new interpreter with given environment variables. It reads nothing but requests of this process, so a copy
holds nothing of the service and nothing of other copies. Both ignore SIGTERM: they end with this process, or by
SIGKILL.
"""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import weakref
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Final

from dohyo.service.forking.process import ForkedProcess

# A signal to all processes of the service, as systemd sends it, is the service's: it lets running episodes end.
PROGRAM: Final = (
    "import json, signal, sys; signal.signal(signal.SIGTERM, signal.SIG_IGN); sys.path[:] = json.loads(sys.argv[1]);"
    " from dohyo.service.forking.program import main; main()"
)
END_S: Final = 10.0


@dataclass(frozen=True, slots=True)
class Template:
    """What all copies of a fork server have in common.

    Attributes:
        prepare: "module:function" that loads their libraries; called once, in the server.
        options: Options of the interpreter.
        quiet: Whether their standard error is thrown away.
    """

    prepare: str
    options: tuple[str, ...] = ()
    quiet: bool = False


@dataclass(frozen=True, slots=True)
class Launch:
    """What one copy runs.

    Attributes:
        entry: "module:function", called with the descriptors of the files.
        name: Name of the process for `ps`, at most 15 characters.
        environment: All its variables.
        folder: Working directory.
        path: Folders that modules are looked for in.
    """

    entry: str
    name: str
    environment: Mapping[str, str]
    folder: Path
    path: Sequence[str]


class ForkServer:
    """A running fork server; it ends with this process."""

    def __init__(self, template: Template, environment: Mapping[str, str]) -> None:
        """Starts the server.

        Raises:
            OSError: It cannot be started.
        """
        self.environment = dict(environment)
        self._control, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            path = json.dumps([entry for entry in sys.path if entry])
            self._process = subprocess.Popen(
                [sys.executable, *template.options, "-c", PROGRAM, path, str(theirs.fileno()), template.prepare],
                pass_fds=(theirs.fileno(),),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL if template.quiet else None,
                stderr=subprocess.DEVNULL if template.quiet else None,
                env=self.environment,
                start_new_session=True,
            )
        self.end = weakref.finalize(self, _end, self._control, self._process)

    @property
    def alive(self) -> bool:
        """Whether the server runs."""
        return self.end.alive and self._process.poll() is None

    def fork(self, launch: Launch, files: Sequence[int]) -> ForkedProcess:
        """Starts a copy, which is the leader of its own session and ends with the server.

        Args:
            launch: What it runs.
            files: Descriptors of files that it gets; it has no others but the standard ones.

        Raises:
            OSError: The server has ended.
        """
        request = {
            "entry": launch.entry,
            "name": launch.name,
            "environment": dict(launch.environment),
            "folder": str(launch.folder),
            "path": list(launch.path),
        }
        pipe, theirs = os.pipe()
        try:
            socket.send_fds(self._control, [json.dumps(request).encode()], [theirs, *files])
        except BaseException:
            os.close(pipe)
            raise
        finally:
            os.close(theirs)
        return ForkedProcess(pipe)


_servers: dict[Template, ForkServer] = {}
_lock = Lock()


def fork(template: Template, common: Mapping[str, str], launch: Launch, files: Sequence[int]) -> ForkedProcess:
    """Starts a copy of the template's server, which is started when there is none.

    Args:
        template: Template of the copy.
        common: Variables of the server: libraries may read them when they are loaded.
        launch: What the copy runs.
        files: Descriptors of files that it gets.

    Raises:
        OSError: It cannot be started.
    """
    server = _running(template, common)
    try:
        return server.fork(launch, files)
    except OSError:
        if server.alive:
            raise
    return _running(template, common).fork(launch, files)  # the machine had ended it


def _running(template: Template, common: Mapping[str, str]) -> ForkServer:
    with _lock:
        server = _servers.get(template)
        if server is None or not server.alive or server.environment != common:
            server = _servers[template] = ForkServer(template, common)
        return server


def _end(control: socket.socket, process: subprocess.Popen[bytes]) -> None:
    control.close()
    process.kill()
    process.wait(END_S)
