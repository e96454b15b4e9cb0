"""Agents whose construction attacks the machine: what a confined process must survive."""

from __future__ import annotations

import json
import mmap
import os
import signal
import socket
import subprocess
import threading
import time
from pathlib import Path

from dohyo.sumo_networks.errors import InvalidInputError


class Environment:
    def __init__(self) -> None:
        raise InvalidInputError(json.dumps(dict(os.environ)))


class Memory:
    def __init__(self) -> None:
        kept = []
        while True:
            kept.append(b"x" * 10_000_000)


class SharedMemory:
    """Memory that the kernel's limit on private data does not count."""

    def __init__(self) -> None:
        kept = []
        while True:
            kept.append(mmap.mmap(-1, 50_000_000))
            kept[-1].write(b"x" * 50_000_000)


class Loop:
    def __init__(self) -> None:
        while True:
            pass


class Sleep:
    def __init__(self) -> None:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        time.sleep(600)


class Fork:
    def __init__(self) -> None:
        if os.fork() == 0:
            time.sleep(600)


class Program:
    def __init__(self) -> None:
        subprocess.run(["/bin/sleep", "600"], check=True)


class Threads:
    def __init__(self) -> None:
        for _ in range(100):
            threading.Thread(target=time.sleep, args=(600,)).start()
        time.sleep(600)


class Network:
    def __init__(self) -> None:
        socket.create_connection(("127.0.0.1", 80))


class Paths:
    """Tries to read and to write each path."""

    def __init__(self, paths: list[str]) -> None:
        done = []
        for path in paths:
            for attempt in (Path.read_bytes, lambda one: one.write_text("written by a stranger"), Path.unlink):
                try:
                    attempt(Path(path))
                except OSError:
                    continue
                done.append(path)
        raise InvalidInputError(f"opened: {done}")


class LargeFile:
    def __init__(self) -> None:
        with open("large", "wb") as file:
            while True:
                file.write(b"x" * 10_000_000)


class ManyFiles:
    def __init__(self) -> None:
        number = 0
        while True:
            number += 1
            Path(f"{number}").write_bytes(b"x" * 500_000)


class Flood:
    """Answers without end."""

    def __init__(self) -> None:
        raise InvalidInputError("x" * 50_000_000)


class Leaver:
    """Tries to be in no process group that the runner ends."""

    def __init__(self) -> None:
        os.setsid()
