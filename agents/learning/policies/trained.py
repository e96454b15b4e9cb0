"""Policies of trainings, for the agents that drive with them: the file, and the card that says how it was trained."""

from __future__ import annotations

from pathlib import Path

from dohyo.agents.learning.files.card import Card, read_card
from dohyo.sumo_networks.errors import InvalidInputError


def policy_file(given: str | Path | None, shipped: Path, trainer: str) -> Path:
    """The policy that an agent drives with: the given one, or the shipped one.

    Args:
        given: ONNX file of a training; None: the shipped one.
        shipped: Where the shipped one is, if there is one.
        trainer: Name in `dohyo train --list`.

    Raises:
        InvalidInputError: The given file is missing, or none is given and none is shipped.
    """
    path = shipped if given is None else Path(given)
    if path.is_file():
        return path
    if given is not None:
        raise InvalidInputError(f"no policy '{path}'")
    raise InvalidInputError(
        f"'{shipped.stem}' has no shipped weights: expected the setting 'policy', such as best.onnx of the run that "
        f"'dohyo train {trainer}' makes"
    )


def card_of(policy: Path, trainer: str) -> Card:
    """Card of a policy, from the folder that it is in.

    Raises:
        InvalidInputError: There is none, it describes another file, or its policy is one of another trainer.
    """
    card = read_card(policy)
    if card.trainer != trainer:
        raise InvalidInputError(f"'{policy}': expected a policy of trainer '{trainer}', got one of '{card.trainer}'")
    return card
