"""Agents: named lines of submissions."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Header
from pydantic import BaseModel, ConfigDict, Field
from sqlalchemy.orm import Session

from dohyo.service.accounts.access import Caller, Reader, Submitter
from dohyo.service.database.engine import serialise
from dohyo.service.database.idempotency import made_before, remember
from dohyo.service.errors import ConflictError, ForbiddenError, NotFoundError, TooManyRequestsError
from dohyo.service.state import ServicesOf
from dohyo.service.submissions import queries as submissions
from dohyo.service.submissions.model import Agent
from dohyo.service.submissions.views import AgentView, view_agent
from dohyo.service.web.bodies.strict_route import StrictRoute
from dohyo.service.web.documents import After, Limit, Name, problems
from dohyo.service.web.spelling import AGENT_NAME
from dohyo.service.web.views import Page
from dohyo.sumo_networks.scenario import content_hash

router = APIRouter(prefix="/v1/agents", tags=["agents"], route_class=StrictRoute)

PER_OWNER = 200

IdempotencyKey = Annotated[
    str | None,
    Header(min_length=1, max_length=200, description="The same request with the same key makes nothing new."),
]


class AgentOrder(BaseModel):
    """The name of a new agent."""

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={"examples": [{"name": "team-blue-mpc", "description": "Model predictive control."}]},
    )

    name: Annotated[str, Field(min_length=1, max_length=100, pattern=AGENT_NAME)]
    description: Annotated[str, Field(max_length=2000)] = ""


@router.post("", status_code=201, responses=problems(403, 409, 413, 507))
def create_agent(
    order: AgentOrder, caller: Submitter, services: ServicesOf, idempotency_key: IdempotencyKey = None
) -> AgentView:
    """Registers an agent; nobody can use the name afterwards, nor one that differs in small and capital letters."""
    request = content_hash({"agent": order.model_dump()})
    with services.database.session() as session:
        serialise(session)
        if made_before(session, caller.owner, idempotency_key, request):
            return view_agent(owned_agent(session, caller, order.name), None)
        if (taken := submissions.find_like(session, order.name)) is not None:
            raise ConflictError(f"agent '{taken.name}' exists; choose another name")
        if submissions.count_agents(session, caller.owner) >= PER_OWNER:
            raise TooManyRequestsError(f"at most {PER_OWNER} agents", retry_s=3600)
        agent = submissions.add_agent(session, order.name, caller.owner, order.description)
        remember(session, caller.owner, idempotency_key, request, agent.id)
        return view_agent(agent, None)


@router.get("", responses=problems())
def list_agents(caller: Reader, services: ServicesOf, limit: Limit = 100, after: After = None) -> Page[AgentView]:
    """Lists agents by name."""
    with services.database.reading() as session:
        rows = submissions.list_agents(session, None if caller.sees_all else caller.owner, limit + 1, after)
    items = [view_agent(agent, latest) for agent, latest in rows[:limit]]
    return Page(items=items, next=items[-1].name if len(rows) > limit else None)


@router.get("/{name}", responses=problems(404))
def get_agent(name: Name, caller: Reader, services: ServicesOf) -> AgentView:
    """One agent."""
    with services.database.reading() as session:
        agent = visible_agent(session, caller, name)
        return view_agent(agent, submissions.find_submission(session, agent))


def visible_agent(session: Session, caller: Caller, name: str) -> Agent:
    """An agent that is visible to the caller.

    Raises:
        NotFoundError: There is none.
    """
    agent = submissions.find_agent(session, name)
    if agent is None or not caller.may_see(agent.owner):
        raise NotFoundError(f"no agent named '{name}'")
    return agent


def owned_agent(session: Session, caller: Caller, name: str) -> Agent:
    """An agent that the caller may submit to and evaluate.

    Raises:
        NotFoundError: No agent of this name is visible to the caller.
        ForbiddenError: The agent belongs to another owner.
    """
    agent = visible_agent(session, caller, name)
    if not caller.owns(agent.owner):
        raise ForbiddenError(f"agent '{name}' is another owner's")
    return agent
