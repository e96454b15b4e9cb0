"""Shipping: the best policy of a training becomes an agent's own weights, and its name is registered.

    python -m dohyo.agents.shipping rlad out/rlad/rlad/seed-0
    make setup          # reads the new entry point

Copies best.onnx with its card into the system's checkpoints/, and adds the agent to pyproject.toml, agents.toml and
settings.json. How it drives is for the system's README.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Final

from dohyo.agents.learning.files.card import digest, read_card, write_card
from dohyo.agents.registry import GROUP, TRAINABLE
from dohyo.evaluation.agent import AgentSpec, make_agent
from dohyo.evaluation.entry import load_entry
from dohyo.evaluation.settings import settings_schema
from dohyo.sumo_networks.errors import DohyoError, InvalidInputError, UnknownNameError
from dohyo.sumo_networks.files import write_atomically

ROOT: Final = Path(__file__).resolve().parents[1]
"""Of the checkout."""


def ship(name: str, run: Path, root: Path = ROOT) -> Path:
    """Ships the best policy of a run; nothing is written unless it drives.

    Args:
        name: Of `TRAINABLE`.
        run: Folder of the training.
        root: Of the checkout.

    Returns:
        The shipped file.

    Raises:
        UnknownNameError: There is no such agent.
        InvalidInputError: The run has no policy that the agent drives with, or this is no checkout.
    """
    if name not in TRAINABLE:
        raise UnknownNameError("agent", name, TRAINABLE)
    if not (root / "pyproject.toml").exists():
        raise InvalidInputError(f"'{root}': expected a checkout of dohyo, which an installation is not")
    entry, policy = TRAINABLE[name], run / "best.onnx"
    agent = make_agent(entry, {"policy": str(policy)})
    agent.warm_up()
    card = read_card(policy)
    shipped = root / "agents" / entry.split(".")[2] / "checkpoints" / f"{name}.onnx"
    shipped.parent.mkdir(exist_ok=True)
    write_atomically(shipped, policy.read_bytes())
    write_card(shipped.parent, name, card.model_copy(update={"files": {shipped.name: digest(shipped)}}))
    _register(name, entry, agent.spec, root)
    return shipped


def _register(name: str, entry: str, spec: AgentSpec, root: Path) -> None:
    """Adds an agent to the files that list agents, unless they have it."""
    project, declared, settings = (
        root / file for file in ("pyproject.toml", "agents/agents.toml", "agents/settings.json")
    )
    text, group = project.read_text(), f'[project.entry-points."{GROUP}"]\n'
    if f'\n{name} = "{entry}"\n' not in text:
        write_atomically(project, text.replace(group, f'{group}{name} = "{entry}"\n').encode())
    text = declared.read_text()
    if f"\n[{name}]\n" not in text:
        told = f'track = "{spec.track}"\ncontrol = "{spec.control}"\nsensors = {json.dumps(list(spec.sensors))}\n'
        write_atomically(declared, f"{text}\n[{name}]\n{told}".encode())
    schemas = json.loads(settings.read_text()) | {name: settings_schema(load_entry(entry, "agent"))}
    ordered = {one: schemas[one] for one in sorted(schemas)}
    write_atomically(settings, (json.dumps(ordered, indent=1) + "\n").encode())


def main() -> None:
    """Command-line entry point."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("name", choices=sorted(TRAINABLE), help="the agent")
    parser.add_argument("run", type=Path, help="folder of its training")
    options = parser.parse_args()
    try:
        print(ship(options.name, options.run))
    except DohyoError as error:
        raise SystemExit(f"dohyo: {error}") from error


if __name__ == "__main__":
    main()
