"""Proxies: the client's address from a trusted proxy's X-Forwarded-For, so that each client has limits of its own."""

from __future__ import annotations

import logging
from collections.abc import Collection

from starlette.types import ASGIApp, Receive, Scope, Send
from uvicorn.middleware.proxy_headers import ProxyHeadersMiddleware

REMEMBERED = 100

logger = logging.getLogger("dohyo.service")


class TrustedProxies:
    """Believes the headers of trusted proxies only; logs which other address sends them, and which proxy too few."""

    def __init__(self, app: ASGIApp, trusted: Collection[str]) -> None:
        # uvicorn's middleware and Starlette's types of ASGI differ in name only.
        self._forwarded = ProxyHeadersMiddleware(app, trusted_hosts=list(trusted))  # type: ignore[arg-type]
        self._warned: set[str] = set()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Replaces the client's address and the scheme."""
        if scope["type"] == "http":
            self._warn(scope)
        await self._forwarded(scope, receive, send)  # type: ignore[arg-type]

    def _warn(self, scope: Scope) -> None:
        """Logs once for each address what is wrong with its headers."""
        address = (scope.get("client") or ("",))[0]
        if address in self._warned or len(self._warned) >= REMEMBERED:
            return
        names = {name for name, _ in scope["headers"]}
        if b"x-forwarded-for" not in names:
            return
        if address not in self._forwarded.trusted_hosts:
            fault = "X-Forwarded-For of %s is ignored; if that is your proxy, name it in DOHYO_TRUSTED_PROXIES"
        elif b"x-forwarded-proto" not in names and scope["scheme"] == "http":
            fault = "the proxy %s sends no X-Forwarded-Proto; if it has TLS, cookies lack Secure until it does"
        else:
            return
        self._warned.add(address)
        logger.warning(fault, address)
