"""Session: a cookie that stands for a bearer token, in requests of this service's own pages; errors as pages."""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable
from typing import Any, Final
from urllib.parse import urlsplit

from fastapi import FastAPI, Request
from starlette.datastructures import Headers
from starlette.requests import cookie_parser
from starlette.responses import Response
from starlette.types import ASGIApp, Receive, Scope, Send

COOKIE: Final = "dohyo_token"
_MACHINES: Final = ("/v1/", "/health", "/metrics", "/static/", "/openapi.json")


MARK: Final = "x-dohyo-page"
"""Header that the dashboard's scripts send with each change; no form and no other site's script can send it."""


class SessionCookie:
    """ASGI middleware: requests under /v1 that carry the cookie and no Authorization get one.

    GET and HEAD need no more. A method that changes something must prove that a page of this service sent it, against
    cross-site request forgery: by the header `MARK` and by what the browser says about the sender (`_proved`). The
    cookie is also SameSite=Strict, so that another site's requests carry none.
    """

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Passes the request on, with the header where it applies."""
        if scope["type"] == "http" and scope["path"].startswith("/v1/"):
            headers = Headers(scope=scope)
            token = _cookie(headers.get("cookie", ""))
            allowed = scope["method"] in ("GET", "HEAD") or _proved(headers)
            if token and allowed and "authorization" not in headers:
                bearer = (b"authorization", f"Bearer {token}".encode("latin-1", "ignore"))
                scope = {**scope, "headers": [*scope["headers"], bearer]}
        await self.app(scope, receive, send)


def same_origin(request: Request) -> bool:
    """Whether a form was sent by a page of this service, according to the browser's headers."""
    site = request.headers.get("sec-fetch-site")
    if site is not None:
        return site in ("same-origin", "none")
    origin = request.headers.get("origin")
    return origin is None or _host(origin) == request.url.netloc


def _proved(headers: Headers) -> bool:
    """Whether the browser says that a page of this service sent a request; silence proves nothing."""
    if MARK not in headers:
        return False
    site = headers.get("sec-fetch-site")
    if site is not None:
        return site == "same-origin"
    origin = headers.get("origin")
    return origin is not None and _host(origin) == headers.get("host")


def _host(origin: str) -> str:
    """Host and port of an origin; empty for one that is none, such as "http://[" or "null"."""
    try:
        return urlsplit(origin).netloc
    except ValueError:
        return ""


def show_errors_as_pages(app: FastAPI, render: Callable[..., Response]) -> None:
    """Wraps the error handlers of an app: browsers get an HTML page, programs still get the problem document.

    Args:
        app: App with all its handlers registered.
        render: The function `pages.render`.
    """
    handlers = {Exception: _unexpected, **app.exception_handlers}
    for kind, handler in handlers.items():
        app.exception_handlers[kind] = _as_page(handler, render)


def _as_page(handler: Callable[..., Any], render: Callable[..., Response]) -> Callable[..., Any]:
    async def handle(request: Request, error: Exception) -> Response:
        answer = handler(request, error)
        if inspect.isawaitable(answer):
            answer = await answer
        response: Response = answer
        if not _is_navigation(request) or response.status_code < 400:
            return response
        page = render(request, "error", status=response.status_code, detail=_detail(response))
        for name in ("retry-after", "www-authenticate", "x-request-id"):
            if name in response.headers:
                page.headers[name] = response.headers[name]
        return page

    return handle


def _unexpected(request: Request, error: Exception) -> Response:
    body = {"type": "about:blank", "title": "Internal Server Error", "status": 500}
    return Response(json.dumps(body), 500, media_type="application/problem+json")


def _is_navigation(request: Request) -> bool:
    return "text/html" in request.headers.get("accept", "") and not request.url.path.startswith(_MACHINES)


def _detail(response: Response) -> str:
    """Content of the problem document; without details for internal errors."""
    try:
        detail = json.loads(bytes(response.body)).get("detail", "") if response.status_code < 500 else ""
    except (AttributeError, ValueError):
        return ""
    return detail if isinstance(detail, str) and detail != "Not Found" else ""


def _cookie(header: str) -> str:
    """The token in a header, whose other cookies may hold anything: those of all ports of a host come together."""
    return cookie_parser(header).get(COOKIE, "")
