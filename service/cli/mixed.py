"""Mixed runs on the command line: agents by mission, and what is shown of several agents."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from dohyo.agents.registry import kind_of, resolve
from dohyo.evaluation.meetings import meetings
from dohyo.evaluation.records.mixed import agents_of
from dohyo.evaluation.records.record import AgentInfo, EpisodeRecord
from dohyo.evaluation.running.run import REST, describe_driver
from dohyo.evaluation.summary import Summary, as_document
from dohyo.service.cli.by_agent import unique_names
from dohyo.service.cli.output import console, print_error, print_rows
from dohyo.sumo_networks.errors import InvalidInputError


def parse_agents(options: Sequence[str]) -> dict[str, str]:
    """Agents by mission from options such as "ego-1=mbappe"; one without a mission is under `REST`.

    Raises:
        InvalidInputError: A mission has two agents, or more than one agent has no mission.
    """
    agents: dict[str, str] = {}
    for option in options:
        mission, equals, agent = option.partition("=")
        name = mission if equals else REST
        if not mission or (equals and not agent):
            raise InvalidInputError(f"--agent '{option}': expected AGENT or MISSION=AGENT")
        if name in agents:
            whose = f"for mission '{name}'" if equals else "without a mission"
            raise InvalidInputError(f"--agent '{option}': expected one agent {whose}, got two")
        agents[name] = agent if equals else option
    return agents


def describe_agents(agents: Mapping[str, str]) -> dict[str, AgentInfo]:
    """Descriptions of the agents of a mixed run; each is made for it, without settings.

    Raises:
        InvalidInputError: An agent cannot be made, or does not drive cars.
    """
    made: dict[str, AgentInfo] = {}
    for name in dict.fromkeys(agents.values()):
        entry = resolve(name)
        made[name] = describe_driver(entry, {}, kind_of(entry, {}), print_error)
    return {mission: made[name] for mission, name in agents.items()}


def scores_document(summaries: Sequence[Summary], records: Sequence[EpisodeRecord]) -> dict[str, Any]:
    """Scores as plain JSON: of one agent, or of each agent of a mixed run with its meetings."""
    if len(summaries) == 1:
        return as_document(summaries[0])
    names = unique_names(agents_of(records))
    met = [
        {"agents": [names[one.agent], names[one.other]], "episodes": one.episodes, "collisions": one.collisions}
        for one in meetings(records)
    ]
    return {"agents": [as_document(summary) for summary in summaries], "meetings": met}


def print_meetings(records: Sequence[EpisodeRecord]) -> None:
    """Prints which agents drove in the same episodes; nothing where there was one agent per episode."""
    met = meetings(records)
    if not met:
        return
    names = unique_names(agents_of(records))
    console.print("agents that met", style="bold")
    rows = [(names[one.agent], names[one.other], str(one.episodes), str(one.collisions)) for one in met]
    print_rows(["agent", "met", "episodes", "collisions with each other"], rows)
