"""Server: uvicorn with the app on an own socket, and a shutdown that lets running episodes end."""

from __future__ import annotations

import asyncio
import gc
import ipaddress
import logging
import os
import resource
import socket
from collections.abc import Callable
from types import FrameType

import uvicorn
from fastapi import FastAPI

from dohyo.service import logs
from dohyo.service.accounts.queries import first_admin_token
from dohyo.service.app import create_app
from dohyo.service.data_folder import held
from dohyo.service.database.engine import Database, usable
from dohyo.service.database.identity import check_folder, claim
from dohyo.service.database.server_lock import server_lock
from dohyo.service.league.routes import check_league
from dohyo.service.settings import Settings, unknown_variables
from dohyo.service.signing.keys import SigningKeys
from dohyo.service.state import Services
from dohyo.service.tls import check_authorities, check_certificate
from dohyo.service.web.connections import ConnectionLimits, Connections, Loop, protocol
from dohyo.sumo_networks.errors import InvalidInputError

KEEP_ALIVE_S = 120
CLOSE_S = 5
OTHER_FILES = 1024  # besides connections: records, databases, pipes of episodes
LOST = 3  # exit code

logger = logging.getLogger("dohyo.service")


def run(settings: Settings, listening: Callable[[str, str | None], None]) -> bool:
    """Runs the service until a signal ends it.

    Args:
        settings: Settings of the service.
        listening: Callback with the URL and, at the very first start, an administrator's token.

    Returns:
        Whether the service started.

    Raises:
        InvalidInputError: The settings cannot be served.
    """
    check_exposure(settings)
    if settings.executor == "ray":
        from dohyo.service.running.cluster import check_cluster  # the extra `cluster`

        check_cluster(settings.ray_address)
    if settings.league:
        check_league()
    logs.configure()
    for sentence in unknown_variables():
        logger.warning(sentence)
    with listen(settings) as own:
        raise_file_limit(settings.connections)
        token = _prepare(settings)  # the last that may be refused: the token is shown once
        scheme = "https" if settings.tls_certificate else "http"
        listening(f"{scheme}://{_shown(settings.host)}:{own.getsockname()[1]}", token)
        app = create_app(settings)
        app.state.services.lost = _end_at_once
        server = DrainingServer(configuration(settings, app), app.state.services)
        server.run(sockets=[own])
    return server.started


def check_exposure(settings: Settings) -> None:
    """Refuses to listen beyond loopback without encryption, unless the settings allow it.

    Raises:
        InvalidInputError: Listening beyond loopback without TLS, or a TLS setting that is incomplete or whose files
            cannot be used.
    """
    certificate, key = settings.tls_certificate, settings.tls_key
    if (certificate is None) != (key is None):
        raise InvalidInputError("TLS: expected both --tls-certificate and --tls-key")
    for file in (certificate, key, settings.webhook_authorities):
        if file is not None and not file.is_file():
            raise InvalidInputError(f"TLS: no file '{file}'")
    if certificate is not None and key is not None:
        check_certificate(certificate, key)
    if settings.webhook_authorities is not None:
        check_authorities(settings.webhook_authorities)
    if certificate is None and not settings.insecure and not _is_loopback(settings.host):
        raise InvalidInputError(
            f"host '{settings.host}' is heard by other machines, and tokens would travel unencrypted; expected"
            " --tls-certificate and --tls-key, or --insecure behind a proxy that encrypts"
        )


class DrainingServer(uvicorn.Server):
    """At the first signal the scheduler drains while workers are still served; at the second, it ends at once."""

    def __init__(self, config: uvicorn.Config, services: Services) -> None:
        super().__init__(config)
        self._services = services
        self._drain: asyncio.Task[None] | None = None

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Stores the loop for signals; freezes existing objects, which the garbage collector then skips."""
        self._loop = asyncio.get_running_loop()
        await super().startup(sockets)
        gc.collect()
        gc.freeze()

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Starts to drain at the first signal and ends at the second; one before the start is over ends it."""
        if self._drain is None and self.started:
            self._loop.call_soon_threadsafe(self._begin)
        else:
            self._services.database.given_up = not self.started
            super().handle_exit(sig, frame)

    def _begin(self) -> None:
        if self._drain is None:
            self._drain = self._loop.create_task(self._drain_and_exit())

    async def _drain_and_exit(self) -> None:
        try:
            await self._services.drain()
        finally:
            self.should_exit = True


def configuration(settings: Settings, app: FastAPI) -> uvicorn.Config:
    """Configuration of uvicorn."""
    limits = ConnectionLimits(settings.connections, settings.connections_per_address, settings.trusted_proxies)
    return uvicorn.Config(
        app,
        loop=f"{Loop.__module__}:{Loop.__qualname__}",
        http=protocol(Connections(limits, app.state.services.metrics)),
        ws="none",
        lifespan="on",
        log_config=None,
        access_log=False,
        server_header=False,
        proxy_headers=False,  # see `web.proxies`
        timeout_keep_alive=KEEP_ALIVE_S,
        timeout_graceful_shutdown=CLOSE_S,
        ssl_certfile=settings.tls_certificate,
        ssl_keyfile=settings.tls_key,
    )


def raise_file_limit(connections: int) -> None:
    """Lets this process open as many files as its connections, records and processes need.

    Raises:
        InvalidInputError: The system allows fewer.
    """
    needed = connections + OTHER_FILES
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft >= needed or soft == resource.RLIM_INFINITY:
        return
    if needed > hard != resource.RLIM_INFINITY:
        raise InvalidInputError(
            f"{connections} connections need {needed} open files, and the system allows {hard}: raise `ulimit -n`, or"
            f" set DOHYO_CONNECTIONS to {max(8, hard - OTHER_FILES)}"
        )
    resource.setrlimit(resource.RLIMIT_NOFILE, (needed, hard))


def listen(settings: Settings) -> socket.socket:
    """Opens the socket to serve on.

    Raises:
        InvalidInputError: The address cannot be used.
    """
    try:
        family = socket.getaddrinfo(settings.host, settings.port, type=socket.SOCK_STREAM)[0][0]
        return socket.create_server((settings.host, settings.port), family=family, backlog=2048)
    except OSError as error:
        where = f"{settings.host}:{settings.port}"
        raise InvalidInputError(f"cannot listen on {where}: {error.strerror or error}") from error


def _prepare(settings: Settings) -> str | None:
    """Creates the folder, the key that signs and the tables; returns the first token if there was none.

    Raises:
        InvalidInputError: The folder or the database cannot be used, or they do not belong together.
    """
    with held(settings):
        database = Database(settings.database_url)
        try:
            with usable():
                check_folder(settings.data, settings.records, database)
            SigningKeys(settings.signing_key, settings.retired_signing_keys).prepare()
            with usable(), server_lock(database):
                claim(settings.data, database)
                with database.session() as session:
                    return first_admin_token(session)
        finally:
            database.close()


def _end_at_once() -> None:
    # As kill -9, after which nothing is lost or doubled: a drain would go on with what another server drives.
    os._exit(LOST)


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _shown(host: str) -> str:
    return f"[{host}]" if ":" in host else host
