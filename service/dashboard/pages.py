"""Pages: HTML shells that ES modules fill from /v1. Nothing is read from the database here.

The token of a signed-in browser is an HttpOnly, SameSite=Strict cookie (`dohyo_token`): no script can read it, unlike
sessionStorage. `SessionCookie` lets it stand for a bearer token, in requests that change something only where this
service's own page sent them.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Annotated, Any, Final
from urllib.parse import urlencode, urlsplit

from fastapi import APIRouter, Depends, Form, Request
from fastapi.responses import HTMLResponse, JSONResponse, RedirectResponse
from fastapi.staticfiles import StaticFiles
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from starlette.responses import Response
from starlette.types import Scope

from dohyo.evaluation.records.specifications import InfractionKind, Status
from dohyo.evaluation.report.style import agent_colours
from dohyo.service.accounts.queries import find_token
from dohyo.service.dashboard.session import COOKIE, same_origin
from dohyo.service.state import ServicesOf

_HERE: Final = Path(__file__).parent
_TOKEN: Final = re.compile(r"[\x21-\x7e]{8,200}")
_MOST_AGENTS: Final = 200


class Assets(StaticFiles):
    """Static modules and styles; browsers revalidate them each time, so that versions are never mixed."""

    async def get_response(self, path: str, scope: Scope) -> Response:
        """Adds the cache headers."""
        response = await super().get_response(path, scope)
        response.headers["cache-control"] = "no-cache"
        return response


def _words() -> Markup:
    """Marks and endings as JSON that is safe inside a script element."""
    vocabulary = {
        "marks": {
            kind.value: {"label": kind.specification.label, "path": kind.specification.mark.path}
            for kind in InfractionKind
        },
        "endings": {status.value: status.outcome.value for status in Status},
    }
    return Markup(json.dumps(vocabulary).replace("<", "\\u003c"))


router = APIRouter(include_in_schema=False)
static = Assets(directory=_HERE / "static", packages=[("dohyo.evaluation.report", "static")])
_templates = Environment(
    loader=PackageLoader("dohyo.service.dashboard"), autoescape=True, undefined=StrictUndefined, trim_blocks=True
)
_templates.globals["words"] = _words()


def render(request: Request, template: str, *, status: int = 200, **values: Any) -> HTMLResponse:
    """A page from its template.

    Args:
        request: The browser's request.
        template: Name of the page, without `.html.j2`.
        status: HTTP status of the answer.
        values: Variables of the template.
    """
    shared = {
        "signed_in": COOKIE in request.cookies, "path": request.url.path, "template": template, "status": status,
        "league": getattr(request.app.state, "league", False),
    }  # fmt: skip
    page = _templates.get_template(f"{template}.html.j2").render(shared | values)
    return HTMLResponse(page, status, headers={"cache-control": "no-store"})


def render_private(request: Request, template: str, **values: Any) -> Response:
    """A page that only callers with a token can fill: a visitor without one is led to the sign-in, and back."""
    if COOKIE in request.cookies:
        return render(request, template, **values)
    url = request.url
    back = f"{url.path}?{url.query}" if url.query else url.path
    return RedirectResponse(f"/login?{urlencode({'next': back})}", status_code=303)


@router.get("/")
def leaderboard(request: Request) -> HTMLResponse:
    """The leaderboard."""
    return render(request, "leaderboard")


@router.get("/league")
def league(request: Request) -> HTMLResponse:
    """The league of dohyo's own systems."""
    return render(request, "league")


@router.get("/evaluations")
def evaluations(request: Request) -> HTMLResponse:
    """All evaluations, newest first, with a selection to compare."""
    return render(request, "evaluations")


@router.get("/agents/{name}")
def agent(request: Request, name: str) -> HTMLResponse:
    """One agent: scores, cells, infractions, evaluations."""
    return render(request, "agent", name=name)


@router.get("/evaluations/{evaluation}")
def evaluation(request: Request, evaluation: str) -> HTMLResponse:
    """One evaluation, live while it runs."""
    return render(request, "evaluation", evaluation=evaluation)


@router.get("/evaluations/{evaluation}/map")
def infraction_map(request: Request, evaluation: str) -> HTMLResponse:
    """Map of an evaluation's infractions."""
    return render(request, "map", evaluation=evaluation)


@router.get("/episodes/{episode}")
def episode(request: Request, episode: str) -> HTMLResponse:
    """One episode: replay, timeline, and the explanation of its score."""
    return render(request, "episode", episode=episode)


@router.get("/worlds")
def worlds(request: Request) -> Response:
    """The worlds of the token's owner, and how to make one."""
    return render_private(request, "worlds")


@router.get("/worlds/{world}")
def world(request: Request, world: str) -> Response:
    """One world, live while it lives, its replay afterwards."""
    return render_private(request, "world", world=world)


@router.get("/compare")
def compare(request: Request) -> HTMLResponse:
    """Comparison of the evaluations that the query names."""
    return render(request, "compare")


@router.get("/api")
def api(request: Request) -> HTMLResponse:
    """Use of the service from a program."""
    return render(request, "api", origin=str(request.base_url).rstrip("/"))


@router.get("/colours")
def colours(agent: str = "") -> JSONResponse:
    """The colour of each agent of a page, by name; `agent` is a JSON list of names."""
    return JSONResponse(agent_colours(_names(agent)), headers={"cache-control": "max-age=86400"})


@router.get("/login")
def login(request: Request, next: str = "/") -> HTMLResponse:
    """Sign-in form for a token."""
    return render(request, "login", next=_local(next), problem="")


def token_check(services: ServicesOf) -> Callable[[str], bool]:
    """Checks whether a token is accepted."""

    def accepted(token: str) -> bool:
        with services.database.reading() as session:
            return find_token(session, token) is not None

    return accepted


@router.post("/login")
def sign_in(
    request: Request,
    accepted: Annotated[Callable[[str], bool], Depends(token_check)],
    token: Annotated[str, Form()] = "",
    next: Annotated[str, Form()] = "/",
) -> Response:
    """Stores a token in a session cookie that scripts cannot read."""
    if not same_origin(request):
        return render(request, "login", status=403, next="/", problem="Sign in from this service's own page.")
    token = token.strip()
    if not _TOKEN.fullmatch(token):
        problem = "That is no token: expected 8 to 200 characters without spaces."
        return render(request, "login", status=422, next=_local(next), problem=problem)
    if not accepted(token):
        problem = "That token is unknown, expired or revoked."
        return render(request, "login", status=401, next=_local(next), problem=problem)
    answer = RedirectResponse(_local(next), status_code=303)
    keep_token(request, answer, token)
    return answer


def keep_token(request: Request, answer: Response, token: str) -> None:
    """Signs the browser in: stores a token in a session cookie that scripts cannot read."""
    secure = request.url.scheme == "https"
    answer.set_cookie(COOKIE, token, httponly=True, samesite="strict", secure=secure, path="/")


@router.post("/logout")
def sign_out(request: Request) -> Response:
    """Deletes the cookie."""
    answer = RedirectResponse("/", status_code=303)
    if same_origin(request):
        answer.delete_cookie(COOKIE, httponly=True, samesite="strict", path="/")
    return answer


def _local(target: str) -> str:
    """The requested path on this service; never an address of another site."""
    try:
        parts = urlsplit(target)
    except ValueError:  # such as "//["
        return "/"
    local = not parts.scheme and not parts.netloc and target.startswith("/") and target[1:2] not in ("/", "\\")
    return target if local and target.isprintable() else "/"


def _names(text: str) -> Iterable[str]:
    try:
        names = json.loads(text)
    except (ValueError, RecursionError):
        return []
    return [name for name in names if isinstance(name, str)][:_MOST_AGENTS] if isinstance(names, list) else []
