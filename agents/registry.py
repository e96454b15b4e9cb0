"""Agents by name: whatever installed packages offer under the entry point group "dohyo.agents".

Lists import no agent: agents.toml declares what those of dohyo see, and settings.json their settings.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from dohyo.evaluation.entry import load_entry
from dohyo.evaluation.families import Family, OtherFamilyError, family_for
from dohyo.evaluation.settings import Schema, settings_schema
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.errors import DohyoError, InvalidInputError, UnknownNameError

if TYPE_CHECKING:
    from dohyo.evaluation.records.record import AgentInfo, Kind

GROUP = "dohyo.agents"
LOCALIZED = "dohyo.agents.localization.localized:Localized"
DECLARED = Path(__file__).with_name("agents.toml")
SETTINGS = Path(__file__).with_name("settings.json")
TRAINABLE: Mapping[str, str] = {
    "griad": "dohyo.agents.gri.griad:Griad",
    "pdm-hybrid": "dohyo.agents.pdm_hybrid.agent:PdmHybrid",
    "rlad": "dohyo.agents.rlad.agent:Rlad",
    "rlfold": "dohyo.agents.rlfold.agent:Rlfold",
}
"""Agents that drive with a policy of one's own training, by name. No list has them before weights are shipped, see
`shipping`."""
SHIELDED = "dohyo.agents.safety.shield:Shielded"
WRAPPERS: Mapping[str, tuple[str, ...]] = {SHIELDED: ("shield",), LOCALIZED: ("localization", "gnss")}
"""Agents that wrap another one, with the names of their own settings."""


def agent_entries() -> dict[str, str]:
    """Each agent's "module:Class" by its name, sorted.

    Raises:
        InvalidInputError: Two installed packages offer the same name.
    """
    entries: dict[str, str] = {}
    for point in sorted(entry_points(group=GROUP), key=lambda point: point.name):
        if entries.setdefault(point.name, point.value) != point.value:
            raise InvalidInputError(f"agent '{point.name}' is offered twice: {entries[point.name]} and {point.value}")
    return entries


class AgentView(Config):
    """What a list shows of an agent.

    Attributes:
        track: Which sensors it may use.
        sensors: What it sees.
        control: How it acts.
        entry: Its "module:Class".
    """

    track: Literal["sensors", "map", "privileged"]
    sensors: tuple[str, ...]
    control: str
    entry: str

    @property
    def family(self) -> Family:
        """Family of benchmarks that it is for."""
        return family_for(self.control)


def agent_schema(name: str) -> Schema:
    """JSON Schema of a registered agent's settings; an agent of another package is imported for it.

    Raises:
        UnknownNameError: No agent is registered under the name.
        InvalidInputError: An agent of another package cannot be imported.
    """
    entry = resolve(name)
    if entry.startswith("dohyo."):
        stored: dict[str, Schema] = json.loads(SETTINGS.read_text(encoding="utf-8"))
        if name in stored:
            return stored[name]
    if entry == name:
        return settings_schema(load_entry(entry, "agent"))
    with _named(name):
        return settings_schema(load_entry(entry, "agent"))


def write_schemas() -> None:
    """Writes settings.json from the constructors of dohyo's agents."""
    ours = {name: entry for name, entry in agent_entries().items() if entry.startswith("dohyo.")}
    schemas = {name: settings_schema(load_entry(entry, "agent")) for name, entry in ours.items()}
    SETTINGS.write_text(json.dumps(schemas, indent=1) + "\n", encoding="utf-8")


def agent_view(name: str) -> AgentView:
    """A registered agent. Those of dohyo are declared in agents.toml, so that none is imported.

    Raises:
        UnknownNameError: No installed package offers the name.
        InvalidInputError: Two offer it; or an agent of another package cannot be described.
    """
    entries = agent_entries()
    if name not in entries:
        raise UnknownNameError("agent", name, entries)
    return _view(name, entries[name], _declared())


def agent_views(report: Callable[[str], None]) -> dict[str, AgentView]:
    """All registered agents by name, without those of other packages that cannot be described.

    Args:
        report: Called with one line for each agent that is left out.

    Raises:
        InvalidInputError: Two installed packages offer the same name.
    """
    declared, views = _declared(), {}
    for name, entry in agent_entries().items():
        try:
            views[name] = _view(name, entry, declared)
        except InvalidInputError as error:
            report(str(error))
    return views


def _declared() -> dict[str, dict[str, Any]]:
    return tomllib.loads(DECLARED.read_text(encoding="utf-8"))


def _view(name: str, entry: str, declared: Mapping[str, Mapping[str, Any]]) -> AgentView:
    if entry.startswith("dohyo.") and name in declared:
        return AgentView(entry=entry, **declared[name])
    with _named(name):
        return _foreign_view(entry)


def _foreign_view(entry: str) -> AgentView:
    """View of an agent of another package: of its class, if it needs settings, else of the agent made without any."""
    kind = load_entry(entry, "agent")
    needed = settings_schema(kind)["required"]
    spec: Any = getattr(kind, "spec", None)
    if not (needed and hasattr(spec, "control")):
        spec = describe_agent(entry, {})
    return AgentView(track=spec.track, sensors=tuple(spec.sensors), control=spec.control, entry=entry)


@contextmanager
def _named(name: str) -> Iterator[None]:
    """Any error of another package's agent as an InvalidInputError with its registered name and package."""
    try:
        yield
    except (Exception, SystemExit) as error:
        package = next((one.dist.name for one in entry_points(group=GROUP) if one.name == name and one.dist), None)
        offered = f"agent '{name}' of package '{package}'" if package else f"agent '{name}'"
        reason = str(error) if isinstance(error, DohyoError) else f"{type(error).__name__}: {error}"
        raise InvalidInputError(f"{offered}: {' '.join(reason.split())}") from error


def describe_agent(entry: str, settings: Mapping[str, Any], kind: Kind = "local") -> AgentInfo:
    """Description of an agent of any family; it is made for it.

    Raises:
        InvalidInputError: The agent cannot be made.
    """
    from dohyo.evaluation.agent import agent_info

    agent = _make_of_any_family(entry, settings)
    try:
        return agent_info(agent, entry, settings, kind)
    finally:
        if hasattr(agent, "close"):
            agent.close()


def _make_of_any_family(entry: str, settings: Mapping[str, Any]) -> Any:
    from dohyo.agents.forecasting.agent import make_forecast_agent
    from dohyo.evaluation.agent import make_agent
    from dohyo.evaluation.parking.agent import make_parking_agent

    for make in (make_forecast_agent, make_agent):  # the first decides by the class, without making it
        try:
            return make(entry, settings)
        except OtherFamilyError:
            continue
    return make_parking_agent(entry, settings)


def resolve(name: str) -> str:
    """The "module:Class" of a registered name, or one of `TRAINABLE`; what already has that form is returned as it is.

    Raises:
        UnknownNameError: No agent has the name.
    """
    if ":" in name:
        return name
    entries = {**TRAINABLE, **agent_entries()}
    if name not in entries:
        raise UnknownNameError("agent", name, entries)
    return entries[name]


def resolve_with(name: str, settings: Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
    """The "module:Class" and settings that make an agent.

    The setting `localization` puts a filter's pose before it, `shield` puts RSS behind it; the shield is the outer one.

    Raises:
        UnknownNameError: No agent is registered under the name.
    """
    entry = resolve(name)
    if "shield" in settings and entry != SHIELDED:
        return SHIELDED, {"inner": entry, **settings}
    if "localization" in settings and entry not in (LOCALIZED, SHIELDED):
        return LOCALIZED, {"inner": entry, **settings}
    return entry, dict(settings)


def wrapped_entries(entry: str, settings: Mapping[str, Any]) -> tuple[list[str], dict[str, Any]]:
    """Entries of an agent and of those that it wraps, the outermost first, and the settings of the innermost.

    Nothing is imported.

    Raises:
        UnknownNameError: A wrapped agent has the form of a registered name, and is not registered.
        InvalidInputError: A wrapped agent's name is no text.
    """
    entries, rest = [entry], dict(settings)
    while (own := WRAPPERS.get(entries[-1])) is not None:
        inner = rest.pop("inner", "autopilot")
        if not isinstance(inner, str):
            raise InvalidInputError(
                f"agent '{entries[-1]}': expected the name of an agent as 'inner', got {inner!r:.80}"
            )
        rest = {name: value for name, value in rest.items() if name not in own}
        further, rest = resolve_with(inner, rest)
        entries.append(further)
    return entries, rest


def is_registered(entry: str, settings: Mapping[str, Any]) -> bool:
    """Whether an installed package offers the agent, and every agent that it wraps."""
    try:
        entries, _ = wrapped_entries(entry, settings)
    except InvalidInputError:
        return False
    return set(entries) <= {*agent_entries().values(), *WRAPPERS}


def kind_of(entry: str, settings: Mapping[str, Any]) -> Kind:
    """Kind of an agent that is built here, for its records."""
    return "builtin" if is_registered(entry, settings) else "local"


if __name__ == "__main__":
    write_schemas()
