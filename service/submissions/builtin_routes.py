"""Built-in agents: those that this service can drive itself, and the settings that they take."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import Annotated, Any

from fastapi import APIRouter
from pydantic import Field

from dohyo.agents.registry import AgentView as RegisteredView
from dohyo.agents.registry import agent_entries, agent_schema, agent_view, agent_views
from dohyo.evaluation.settings import Schema, check_against, names_a_path
from dohyo.service.accounts.access import Reader
from dohyo.service.errors import NotFoundError
from dohyo.service.web.documents import Name, problems
from dohyo.service.web.heavy import heavy_read
from dohyo.service.web.views import View
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError

logger = logging.getLogger("dohyo.service")
router = APIRouter(prefix="/v1/builtin-agents", tags=["agents"])


class BuiltinAgentView(View):
    """An agent that the service drives itself."""

    name: Annotated[str, Field(description="To be given as `entry` of a submission.", examples=["autopilot"])]
    track: Annotated[str, Field(description="Which sensors it may use.", examples=["privileged"])]
    sensors: Annotated[list[str], Field(description="Names of the sensors that it reads.")]
    control: Annotated[str, Field(description="Name of its control interface.")]
    settings: Annotated[
        dict[str, Any], Field(description="JSON Schema of the settings that a submission may give, with defaults.")
    ]


@router.get("", responses=problems())
@heavy_read
def list_builtin_agents(caller: Reader) -> list[BuiltinAgentView]:
    """Lists the built-in agents with the schemas of their settings."""
    views = agent_views(report=lambda fault: logger.warning("left out of the built-in agents: %s", fault))
    return [_view(name, view) for name, view in views.items()]


@router.get("/{name}", responses=problems(404))
def get_builtin_agent(name: Name, caller: Reader) -> BuiltinAgentView:
    """One built-in agent."""
    entries = agent_entries()
    if name not in entries:
        raise NotFoundError(str(UnknownNameError("built-in agent", name, entries)))
    try:
        return _view(name, agent_view(name))
    except InvalidInputError as error:  # the list leaves it out, too
        raise NotFoundError(str(error)) from error


def check_builtin(name: str, settings: Mapping[str, Any]) -> None:
    """Checks a submission's settings of a built-in agent by its schema; nothing is built.

    Raises:
        UnknownNameError: There is no such agent.
        SettingsError: Settings are unknown, of another type, or out of range.
    """
    entries = agent_entries()
    if name not in entries:
        raise UnknownNameError("built-in agent", name, entries)
    check_against(builtin_schema(name), f"built-in agent '{name}'", settings)


def builtin_schema(name: str) -> Schema:
    """JSON Schema of a built-in agent's settings, without paths: a stranger names no file of this machine."""
    schema = agent_schema(name)
    return {**schema, "properties": {key: one for key, one in schema["properties"].items() if not names_a_path(one)}}


def _view(name: str, view: RegisteredView) -> BuiltinAgentView:
    return BuiltinAgentView(
        name=name,
        track=view.track,
        sensors=list(view.sensors),
        control=view.control,
        settings=dict(builtin_schema(name)),
    )
