"""Probe: attempts of a confined process to do what it may not, and the layers of confinement on this machine."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from dohyo.service.confinement.folders import private_folder
from dohyo.service.confinement.limits import MEGABYTE, Limits
from dohyo.service.confinement.process import START_S, ConfinedProcess
from dohyo.service.confinement.tasks import Rights

TASKS = {
    Rights.COMPUTE: "attempt_to_compute",
    Rights.FILES: "attempt_with_files",
    Rights.PROGRAMS: "attempt_with_programs",
}


def attempt(arguments: Mapping[str, Any]) -> dict[str, str]:
    """Attempts forbidden actions, in a confined process, and returns the result of each."""
    parent, memory = int(arguments["parent"]), int(arguments["memory_mb"]) * MEGABYTE
    attempts: dict[str, Callable[[], object]] = {
        "open a socket": socket.socket,
        "open a local socket": lambda: socket.socket(socket.AF_UNIX),
        "read a file": lambda: os.open("/etc/passwd", os.O_RDONLY),
        "read its parent's environment": lambda: os.open(f"/proc/{parent}/environ", os.O_RDONLY),
        "read a file that it was told of": lambda: os.open(arguments["secret"], os.O_RDONLY),
        "write a file": lambda: os.open(arguments["secret"] + ".new", os.O_WRONLY | os.O_CREAT),
        "change a file's mode": lambda: os.chmod(arguments["secret"], 0o777),
        "remove a file": lambda: os.unlink(arguments["secret"]),
        "list a directory": lambda: os.listdir("/"),
        "signal its parent": lambda: os.kill(parent, 0),
        "slow its parent down": lambda: os.setpriority(os.PRIO_PROCESS, parent, 19),
        "leave its process group": os.setsid,
        "change its user": lambda: os.setuid(1),
        "run a foreign program": lambda: subprocess.run(["/bin/true"], check=True),
        "take more memory": lambda: bytearray(2 * memory),
    }
    if not arguments["programs"]:
        attempts["start a process"] = lambda: os.fork() or os._exit(0)
    if arguments["rights"] == Rights.COMPUTE:
        attempts["open a pair of sockets"] = socket.socketpair
        attempts["start a thread"] = lambda: threading.Thread(target=print).start()
    return {name: _result(one) for name, one in attempts.items()}


def probe(rights: Rights, secret: Path, limits: Limits | None = None) -> dict[str, Any]:
    """Layers of confinement on this machine, and the results of a process's attempts to escape.

    Args:
        rights: Rights of the process.
        secret: A file of this process's user, which the process is told of.
        limits: Limits of the process.

    Raises:
        ConfinementError: The process cannot be started or confined.
    """
    limits = limits or Limits(memory_mb=1000)
    arguments = {
        "parent": os.getpid(),
        "memory_mb": limits.memory_mb,
        "secret": str(secret),
        "rights": rights,
        "programs": rights is Rights.PROGRAMS,
    }
    with private_folder() as folder:
        process = ConfinedProcess(TASKS[rights], limits, folder=folder)
        try:
            process.send(json.dumps(arguments).encode(), START_S, "probing")
            return {**process.layers, "attempts": json.loads(process.receive(START_S, "probing"))}
        finally:
            process.end()


def _result(one: Callable[[], object]) -> str:
    try:
        one()
    except (OSError, MemoryError, RuntimeError) as error:
        return f"refused: {getattr(error, 'strerror', None) or type(error).__name__}"
    return "possible"
