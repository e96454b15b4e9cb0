"""Builds the agents of a record. A record is data of a stranger: it must not choose which code runs here.

Without `trust` an agent is built only if an installed package registers it (or it is an uploaded policy, which runs
confined), its source files have the digest in the record, and no setting names a file. All of that is checked before a
module of the agent is imported that is not registered, and before any agent is constructed.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

from dohyo.agents.registry import is_registered, wrapped_entries
from dohyo.evaluation.agent import Agent, agent_info, make_agent, source_digest
from dohyo.evaluation.entry import load_entry
from dohyo.evaluation.episode.runner import versions
from dohyo.evaluation.records.mixed import agents_of
from dohyo.evaluation.records.record import AgentInfo, EpisodeRecord
from dohyo.service.forecasting.interface import POLICY as FORECASTER
from dohyo.service.parking.interface import POLICY as PARKER
from dohyo.service.policies.agent import ENTRY as POLICY
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.networks.entries import network_names

POLICY_SETTINGS: Final[Mapping[str, frozenset[str]]] = {
    POLICY: frozenset({"sha256", "name", "track", "sensors", "control", "onnxruntime"}),
    PARKER: frozenset({"sha256", "name", "state", "onnxruntime"}),
    FORECASTER: frozenset({"sha256", "name", "onnxruntime"}),
}
"""Settings of an uploaded policy in a record, by its entry."""


class UntrustedRecordError(InvalidInputError):
    """A record names code or files that only its author vouches for."""


def build_agents(record: EpisodeRecord, *, trust: bool = False, policy: Path | None = None) -> dict[str, Agent]:
    """The agents of a record by ego, ready to drive its scenario again.

    Args:
        record: Record with a correct hash.
        trust: Whether to build whatever the record names.
        policy: ONNX file of the record's policy; None: it lies in the folder of uploaded policies.

    Raises:
        UntrustedRecordError: An agent, a setting or the network is not one that the record may choose.
        InvalidInputError: The versions or an agent differ from those of the record, or an agent cannot be made.
    """
    network = record.scenario.network
    if not trust and network not in network_names():
        raise UntrustedRecordError(f"network '{network}' is not in the catalog here")
    now = versions(load_network(network))
    if now != record.versions:
        raise InvalidInputError(f"the record was made by {record.versions}: expected the same versions here, got {now}")
    if not trust:
        for info in agents_of([record]):
            check_known(info)
    agents: dict[str, Agent] = {}
    try:
        for ego in record.egos:
            agents[ego.name] = _build(ego.agent, policy)
    except InvalidInputError:
        close_all(agents.values())
        raise
    return agents


def check_known(info: AgentInfo) -> None:
    """Checks that an agent may be built from its description alone; constructs nothing.

    Raises:
        UntrustedRecordError: Its entry is not registered here, or a setting names a file.
        InvalidInputError: Its code differs from that in the record.
    """
    if info.kind == "remote":
        raise UntrustedRecordError(
            f"agent '{info.name}' drove through policy workers, so its decisions cannot be repeated here"
        )
    if info.entry in POLICY_SETTINGS:
        unknown = sorted(set(info.settings) - POLICY_SETTINGS[info.entry])
        if unknown:
            raise UntrustedRecordError(f"policy '{info.name}': a record has no setting '{unknown[0]}'")
        _compare(info, [load_entry(info.entry, "agent")])
        return
    if not is_registered(info.entry, info.settings):
        raise UntrustedRecordError(f"agent '{info.name}': no installed package registers '{info.entry}'")
    entries, settings = wrapped_entries(info.entry, info.settings)
    classes = [load_entry(entry, "agent") for entry in entries]
    _compare(info, classes)
    files = sorted(set(settings) & _path_settings(classes[-1]))
    if files:
        raise UntrustedRecordError(f"agent '{info.name}': setting '{files[0]}' names a file")


def close_all(agents: Iterable[Agent]) -> None:
    """Frees the resources of agents."""
    for agent in agents:
        if hasattr(agent, "close"):
            agent.close()


def _build(info: AgentInfo, policy: Path | None) -> Agent:
    settings: dict[str, Any] = dict(info.settings)
    if info.entry == POLICY and policy is not None:
        settings["path"] = str(policy)
    agent = make_agent(info.entry, settings)
    made = agent_info(agent, info.entry, info.settings, info.kind)
    if made.model_copy(update={"name": info.name}) != info:  # a service may give it a name of its own
        close_all([agent])
        raise _changed(info)
    return agent


def _compare(info: AgentInfo, classes: list[type]) -> None:
    if source_digest(classes) != info.source_sha256:
        raise _changed(info)


def _changed(info: AgentInfo) -> InvalidInputError:
    return InvalidInputError(f"agent '{info.name}' has changed since the record was made, or is another one here")


def _path_settings(made: type) -> set[str]:
    """Names of the constructor's arguments that may be paths, by their declared types."""
    return {one.name for one in inspect.signature(made).parameters.values() if "Path" in str(one.annotation)}
