"""Pages of challenges, of a participant's account and of submissions; and the form that redeems an invitation."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated

from fastapi import APIRouter, Depends, Form, Request
from fastapi.responses import HTMLResponse
from pydantic import ValidationError
from starlette.responses import Response

from dohyo.service.accounts.access import Caller
from dohyo.service.accounts.queries import find_token
from dohyo.service.challenges.invitation_routes import redeem_invitation
from dohyo.service.challenges.orders import Redemption
from dohyo.service.challenges.views import RedeemedView
from dohyo.service.dashboard.pages import keep_token, render, render_private
from dohyo.service.dashboard.session import COOKIE, same_origin
from dohyo.service.errors import ServiceError
from dohyo.service.state import ServicesOf
from dohyo.sumo_networks.errors import InvalidInputError

router = APIRouter(include_in_schema=False)


@router.get("/challenges")
def challenges(request: Request) -> HTMLResponse:
    """All challenges; organisers make new ones here."""
    return render(request, "challenges")


@router.get("/challenges/{name}")
def challenge(request: Request, name: str) -> HTMLResponse:
    """One challenge: phases, boards, the reader's team and runs, rules."""
    return render(request, "challenge", name=name)


@router.get("/challenges/{name}/organise")
def organise(request: Request, name: str) -> HTMLResponse:
    """The organiser's page of a challenge."""
    return render(request, "organise", name=name)


@router.get("/submit")
def submit(request: Request) -> Response:
    """Form that submits an agent."""
    return render_private(request, "submit")


@router.get("/account")
def account(request: Request) -> Response:
    """The reader's tokens and agents."""
    return render_private(request, "account")


@router.get("/join")
def join(request: Request) -> HTMLResponse:
    """Form that redeems an invitation."""
    return render(request, "join", given={}, problems={})


def admission(request: Request, services: ServicesOf) -> Callable[[Redemption], RedeemedView]:
    """Redeems an invitation for the owner of the session's token; without a session, for a new owner."""
    secret = request.cookies.get(COOKIE, "")
    with services.database.reading() as session:
        token = find_token(session, secret) if secret else None
    caller = Caller(token.owner, token.role, token.id, services.settings.public) if token else None
    return lambda order: redeem_invitation(order, caller, services)


@router.post("/join")
def redeem(
    request: Request,
    admit: Annotated[Callable[[Redemption], RedeemedView], Depends(admission)],
    code: Annotated[str, Form()] = "",
    owner: Annotated[str, Form()] = "",
    team: Annotated[str, Form()] = "",
) -> Response:
    """Redeems an invitation; a new owner's token is shown once and signs the browser in."""
    given = {"code": code.strip(), "owner": owner.strip(), "team": team.strip()}
    if not same_origin(request):
        return render(request, "join", status=403, given={}, problems={"": "Send the form of this service's own page."})
    try:
        made = admit(Redemption.model_validate({name: value for name, value in given.items() if value}))
    except (ValidationError, ServiceError, InvalidInputError) as error:
        status = error.status if isinstance(error, ServiceError) else 422
        return render(request, "join", status=status, given=given, problems=_problems(error))
    answer = render(request, "joined", made=made, signed_in=True)
    if made.token is not None:
        keep_token(request, answer, made.token)
    return answer


def _problems(error: Exception) -> dict[str, str]:
    """Faults by the name of their field; "" for the form as a whole."""
    if isinstance(error, ValidationError):
        return {str(fault["loc"][0]) if fault["loc"] else "": fault["msg"] for fault in error.errors()}
    text = str(error)
    place = next((name for name in ("code", "owner", "team") if text.startswith((f"{name}:", f"{name} "))), "")
    return {place or ("code" if "code" in text else ""): text.removeprefix(f"{place}: ") if place else text}
