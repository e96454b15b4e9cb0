"""Trial of a built-in agent: built once with a stranger's settings, in a confined process."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from dohyo.evaluation.agent import agent_info, make_agent


def describe_agent(arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Builds an agent with settings and returns its AgentInfo."""
    entry, settings = arguments["entry"], arguments["settings"]
    agent = make_agent(entry, settings)
    try:
        return agent_info(agent, entry, settings, "builtin").model_dump(mode="json")
    finally:
        if hasattr(agent, "close"):
            agent.close()
