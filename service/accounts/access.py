"""Access: the caller of a request and its permissions. A route names its rule by the type of an argument.

A `Reader` may read public data and the token owner's own; a `Submitter` changes its own data; a `WorkerCaller` drives;
an `Organiser` changes its own challenges; an `Admin` may do everything. Data that a caller may not see is answered with
404, never 403.
"""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from functools import partial
from typing import Annotated

from fastapi import Depends, Request
from fastapi.security import HTTPAuthorizationCredentials, HTTPBearer

from dohyo.service.accounts.model import Role, Token
from dohyo.service.accounts.queries import find_token
from dohyo.service.database.engine import Database
from dohyo.service.errors import ForbiddenError, UnauthorisedError
from dohyo.service.state import ServicesOf
from dohyo.service.web.own_threads import OwnThreads

LONGEST_TOKEN = 200
_THREADS = OwnThreads("tokens", 8)

_bearer = HTTPBearer(auto_error=False, description="A token, as `dohyo tokens create` or `POST /v1/tokens` gives it.")


@dataclass(frozen=True, slots=True)
class Caller:
    """The sender of a request.

    Attributes:
        owner: Owner of the token; empty for a caller without a token.
        role: Role of the token.
        token_id: Identifier of the token; None without a token.
        public: Whether all results of this service are public.
    """

    owner: str
    role: Role
    token_id: str | None
    public: bool

    @property
    def is_admin(self) -> bool:
        """Whether everything is allowed."""
        return self.role is Role.ADMIN

    @property
    def sees_all(self) -> bool:
        """Whether other owners' agents, evaluations and episodes can be read."""
        return self.public or self.is_admin

    def owns(self, owner: str) -> bool:
        """Whether the caller may change an owner's data."""
        return self.is_admin or (self.token_id is not None and self.owner == owner)

    def organises(self, owner: str) -> bool:
        """Whether the caller may change the challenges of an owner."""
        return self.is_admin or (self.role is Role.ORGANISER and self.owner == owner)

    def may_see(self, owner: str) -> bool:
        """Whether an owner's agents, evaluations and episodes can be read."""
        return self.sees_all or self.owns(owner)


Credentials = Annotated[HTTPAuthorizationCredentials | None, Depends(_bearer)]


async def identify(request: Request, credentials: Credentials, services: ServicesOf) -> Caller | None:
    """Caller that a token identifies; None without a token.

    Raises:
        UnauthorisedError: The header holds no valid token.
    """
    public = services.settings.public
    known: Caller | None = getattr(request.state, "caller", None)
    if known is not None:  # before the body was read
        return known
    if credentials is None:
        if "authorization" in request.headers:
            raise UnauthorisedError()
        return None
    if len(credentials.credentials) > LONGEST_TOKEN:
        raise UnauthorisedError()
    find = partial(_find, services.database, credentials.credentials)
    token = await _THREADS.run(find)
    if token is None:
        raise UnauthorisedError()
    caller = Caller(token.owner, token.role, token.id, public)
    request.state.caller = caller
    return caller


def _find(database: Database, secret: str) -> Token | None:
    with database.reading() as session:
        return find_token(session, secret)


Identified = Annotated[Caller | None, Depends(identify)]


async def _reader(caller: Identified, services: ServicesOf) -> Caller:
    if caller is not None:
        return caller
    if not services.settings.public:
        raise UnauthorisedError()
    return Caller("", Role.READER, None, public=True)


async def _holder(caller: Identified) -> Caller:
    if caller is None:
        raise UnauthorisedError()
    return caller


def _requiring(*roles: Role) -> Callable[[Caller], Coroutine[None, None, Caller]]:
    async def check(caller: Annotated[Caller, Depends(_holder)]) -> Caller:
        if caller.role not in roles:
            wanted = " or ".join(roles)
            raise ForbiddenError(f"expected a token of role {wanted}, yours is {caller.role}")
        return caller

    return check


Reader = Annotated[Caller, Depends(_reader)]
Holder = Annotated[Caller, Depends(_holder)]
Submitter = Annotated[Caller, Depends(_requiring(Role.SUBMITTER, Role.ORGANISER, Role.ADMIN))]
WorkerCaller = Annotated[Caller, Depends(_requiring(Role.WORKER, Role.SUBMITTER, Role.ORGANISER, Role.ADMIN))]
Organiser = Annotated[Caller, Depends(_requiring(Role.ORGANISER, Role.ADMIN))]
Admin = Annotated[Caller, Depends(_requiring(Role.ADMIN))]
