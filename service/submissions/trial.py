"""Trial of a built-in agent: built once with a stranger's settings, in a confined process."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from dohyo.agents import registry


def describe_agent(arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Builds an agent with settings and returns its AgentInfo."""
    return registry.describe_agent(arguments["entry"], arguments["settings"], "builtin").model_dump(mode="json")
