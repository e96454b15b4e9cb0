"""Proxies: the client's address from a trusted proxy's X-Forwarded-For, so that each client has limits of its own."""

from __future__ import annotations

import logging
from collections.abc import Collection

from starlette.types import ASGIApp, Receive, Scope, Send
from uvicorn.middleware.proxy_headers import ProxyHeadersMiddleware

REMEMBERED = 100

logger = logging.getLogger("dohyo.service")


class TrustedProxies:
    """Believes the headers of trusted proxies only, and logs which other address sends them."""

    def __init__(self, app: ASGIApp, trusted: Collection[str]) -> None:
        # uvicorn's middleware and Starlette's types of ASGI differ in name only.
        self._forwarded = ProxyHeadersMiddleware(app, trusted_hosts=list(trusted))  # type: ignore[arg-type]
        self._ignored: set[str] = set()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Replaces the client's address and the scheme."""
        if scope["type"] == "http":
            self._warn(scope)
        await self._forwarded(scope, receive, send)  # type: ignore[arg-type]

    def _warn(self, scope: Scope) -> None:
        address = (scope.get("client") or ("",))[0]
        if address in self._forwarded.trusted_hosts or address in self._ignored or len(self._ignored) >= REMEMBERED:
            return
        if any(name == b"x-forwarded-for" for name, _ in scope["headers"]):
            self._ignored.add(address)
            logger.warning(
                "X-Forwarded-For of %s is ignored; if that is your proxy, name it in DOHYO_TRUSTED_PROXIES", address
            )
