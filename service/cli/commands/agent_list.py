"""`dohyo agents list` and `dohyo agents show`, from entry points and declarations alone."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from dohyo.agents.registry import agent_entries, agent_schema, agent_view, agent_views, resolve
from dohyo.evaluation.settings import expected
from dohyo.service.cli.output import Json, print_error, print_json, print_rows
from dohyo.service.cli.own_modules import find_own_modules
from dohyo.sumo_networks.errors import InvalidInputError


def list_agents(json: Json = False) -> None:
    """Lists the registered agents."""
    views = agent_views(report=lambda fault: print_error(f"left out: {fault}"))
    if json:
        print_json(
            [
                {"name": name, "family": view.family, **view.model_dump(mode="json"), "settings": agent_schema(name)}
                for name, view in views.items()
            ]
        )
        return
    print_rows(
        ("name", "family", "track", "control", "sensors"),
        [(name, view.family, view.track, view.control, ", ".join(view.sensors)) for name, view in views.items()],
    )


def show(
    name: Annotated[str, typer.Argument(help="A registered name, or module:Class of your own.")], json: Json = False
) -> None:
    """Shows the settings of an agent: types, ranges and defaults."""
    if ":" in name:
        find_own_modules()
    schema = agent_schema(name)
    if json:
        print_json({"name": name, **_declared(name), "settings": schema})
        return
    print_rows(
        ("setting", "takes", "default", ""),
        [(key, expected(one), _default(one), one.get("description", "")) for key, one in schema["properties"].items()],
    )


def _declared(name: str) -> dict[str, Any]:
    """What is known of an agent without settings; of one that cannot be described, its entry."""
    if name in agent_entries():
        try:
            return agent_view(name).model_dump(mode="json")
        except InvalidInputError as error:
            print_error(f"only its settings are known: {error}")
    return {"entry": resolve(name)}


def _default(setting: dict[str, Any]) -> str:
    return str(setting["default"]) if "default" in setting else ""
