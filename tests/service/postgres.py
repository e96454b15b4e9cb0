"""A real PostgreSQL for tests: started on a free port in a temporary folder, ended with the tests."""

from __future__ import annotations

import contextlib
import os
import pwd
import shutil
import signal
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import psycopg
import pytest

START_S = 180.0


def binaries() -> Path | None:
    """The newest version's programs."""
    found = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"), key=lambda path: int(path.parts[-3]))
    if found:
        return found[-1].parent
    initdb = shutil.which("initdb")
    return Path(initdb).resolve().parent if initdb else None


@contextlib.contextmanager
def running() -> Iterator[str]:
    """A server's URL, of a database that every test replaces by its own."""
    programs = binaries()
    if programs is None:
        pytest.skip("PostgreSQL is not installed (Debian: apt-get install postgresql)")
    # It refuses to run as root.
    nobody = pwd.getpwnam("nobody")
    account = {"user": nobody.pw_uid, "group": nobody.pw_gid, "extra_groups": []} if os.getuid() == 0 else {}
    folder = Path(tempfile.mkdtemp(prefix="dohyo-postgres-"))
    if account:
        os.chown(folder, nobody.pw_uid, nobody.pw_gid)
    data, log = folder / "data", folder / "log"
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    options = f"-F -c listen_addresses=127.0.0.1 -c unix_socket_directories={folder} -p {port}".split()
    try:
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "cwd": "/", **account}
        made = subprocess.run(
            [programs / "initdb", "-D", data, "-U", "dohyo", "-A", "trust", "-E", "UTF8", "--no-sync"],
            check=False,
            **quiet,
        )
        if made.returncode:
            pytest.skip(f"PostgreSQL cannot be set up here: {made.stderr.decode(errors='replace').strip()[-300:]}")
        with log.open("wb") as messages:
            server = subprocess.Popen(
                [programs / "postgres", "-D", data, *options], stdout=messages, stderr=messages, cwd="/", **account
            )
        try:
            url = f"postgresql://dohyo@127.0.0.1:{port}/postgres"
            _wait(url, server, log)
            yield url
        finally:
            server.send_signal(signal.SIGINT)
            server.wait(timeout=START_S)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def fresh_database(url: str, name: str, like: str = "template1", encoding: str | None = None) -> str:
    """The URL of a new database of a server, a copy of another one; that of `template1` is empty.

    Args:
        url: Of the server.
        name: Of the new database.
        like: Of the one to copy.
        encoding: Its own one, of an empty database.
    """
    own = "" if encoding is None else f" ENCODING '{encoding}' LOCALE 'C'"
    with psycopg.connect(url, autocommit=True) as connection:
        connection.execute(f'CREATE DATABASE "{name}" TEMPLATE "{like}"{own}')  # type: ignore[arg-type]  # of ours
    return url.rsplit("/", 1)[0] + f"/{name}"


def _wait(url: str, server: subprocess.Popen[bytes], log: Path) -> None:
    deadline = time.monotonic() + START_S
    while True:
        try:
            psycopg.connect(url, connect_timeout=20).close()
            return
        except psycopg.OperationalError:
            if server.poll() is not None or time.monotonic() > deadline:
                pytest.skip(f"PostgreSQL does not start here: {log.read_text(errors='replace')[-300:]}")
            time.sleep(0.1)
