"""`dohyo agents list`, from entry points and their table alone."""

from __future__ import annotations

from dohyo.agents.registry import agent_views
from dohyo.service.cli.output import Json, print_json, print_rows


def list_agents(json: Json = False) -> None:
    """Lists the registered agents."""
    rows = [{"name": name, **view.model_dump(mode="json")} for name, view in agent_views().items()]
    if json:
        print_json(rows)
        return
    print_rows(
        ("name", "track", "control", "sensors"),
        [(row["name"], row["track"], row["control"], ", ".join(row["sensors"])) for row in rows],
    )
