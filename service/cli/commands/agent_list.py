"""`dohyo agents list` and `dohyo agents show`, from entry points and declarations alone."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from dohyo.agents.registry import agent_entries, agent_schema, agent_views, resolve
from dohyo.evaluation.settings import expected
from dohyo.service.cli.output import Json, print_json, print_rows


def list_agents(json: Json = False) -> None:
    """Lists the registered agents."""
    views = agent_views()
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
    schema = agent_schema(name)
    if json:
        declared = agent_views()[name].model_dump(mode="json") if name in agent_entries() else {"entry": resolve(name)}
        print_json({"name": name, **declared, "settings": schema})
        return
    print_rows(
        ("setting", "takes", "default", ""),
        [(key, expected(one), _default(one), one.get("description", "")) for key, one in schema["properties"].items()],
    )


def _default(setting: dict[str, Any]) -> str:
    return str(setting["default"]) if "default" in setting else ""
