"""Cards: where shipped weights come from. `card.json` of a folder has one card for each model in it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import Field, ValidationError

from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import write_atomically

CARDS = "card.json"
WEIGHTS: Final = (".safetensors", ".onnx")
"""Endings of the files that a card describes."""
LICENCE: Final = "Apache-2.0"
UNKNOWN: Final = "unknown"

Unknown = Literal["unknown"]
Digest = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
Natural = Annotated[int, Field(ge=0)]


class Card(Config):
    """Origin of one model. "unknown" stands where nobody kept a fact; None where there is none to know.

    Attributes:
        files: SHA-256 of each of its weight files, by name.
        subject: What it was trained for: a task, or a few words.
        trainer: Name in `dohyo train --list`, or the module that trained it; None: it is fitted by a formula.
        command: Command that trained it.
        commits: Commits of this repository that trained it, one per session if they differ.
        uncommitted: Whether there were changes that no commit has.
        config: Resolved settings.
        data_sha256: Digest of the data, see `digest`; None: it learned in simulation, from no data set.
        seed: Of the training; None: nothing in it is random.
        steps: Environment steps, or gradient steps if there is no environment.
        device: Torch's name of the device.
        tier: Scale: 1 as large as its source's, 2 reduced, 3 a trial.
        metrics: Results of the training's own evaluation, by name.
        licence: SPDX identifier of the weights' licence.
        note: What else a reader must know.
    """

    files: Annotated[dict[str, Digest], Field(min_length=1)]
    subject: str
    trainer: str | None
    command: str
    commits: Annotated[tuple[str, ...], Field(min_length=1)] | Unknown
    uncommitted: bool | Unknown
    config: dict[str, Any] | Unknown
    data_sha256: Digest | Unknown | None
    seed: Natural | Unknown | None
    steps: Natural | Unknown | None
    device: str
    tier: Literal[1, 2, 3] | Unknown
    metrics: dict[str, int | float | None] | Unknown
    licence: str = LICENCE
    note: str = ""


def digest(path: Path) -> str:
    """SHA-256 of a file's bytes; of a folder, that of the names and digests of its files."""
    if path.is_file():
        return hashlib.sha256(path.read_bytes()).hexdigest()
    lines = (f"{digest(one)}  {one.relative_to(path).as_posix()}\n" for one in sorted(path.rglob("*")) if one.is_file())
    return hashlib.sha256("".join(lines).encode()).hexdigest()


def weights_of(folder: Path, model: str) -> dict[str, str]:
    """Digests of the weight files of a model, FOLDER/MODEL.safetensors and FOLDER/MODEL.onnx, by name."""
    paths = [folder / f"{model}{ending}" for ending in WEIGHTS]
    return {path.name: digest(path) for path in paths if path.exists()}


def write_card(folder: Path, model: str, card: Card) -> None:
    """Writes or replaces the card of one model; the others of the folder stay."""
    cards = (read_cards(folder) if (folder / CARDS).exists() else {}) | {model: card}
    document = {name: cards[name].model_dump(mode="json") for name in sorted(cards)}
    write_atomically(folder / CARDS, (json.dumps(document, indent=1, ensure_ascii=False) + "\n").encode())


def read_cards(folder: Path) -> dict[str, Card]:
    """Cards of a folder by model.

    Raises:
        InvalidInputError: There is no card.json, or it is damaged.
    """
    path = folder / CARDS
    try:
        document: Mapping[str, Any] = json.loads(path.read_bytes())
        return {name: Card.model_validate(card) for name, card in document.items()}
    except OSError as error:
        raise InvalidInputError(f"'{path}': expected the cards of the weights here, got {error.strerror}") from error
    except ValidationError as error:
        first = error.errors()[0]
        raise InvalidInputError(f"'{path}': {'.'.join(map(str, first['loc']))}: {first['msg']}") from error
    except (ValueError, AttributeError) as error:
        raise InvalidInputError(f"'{path}': expected cards by model, damaged: {error}") from error


def read_card(weights: Path) -> Card:
    """Card of a weight file, which must be the file that the card describes.

    Raises:
        InvalidInputError: No card names the file, or the file is another one.
    """
    for card in read_cards(weights.parent).values():
        if weights.name in card.files:
            if card.files[weights.name] != (found := digest(weights)):
                raise InvalidInputError(
                    f"'{weights}': expected the file of its card, {card.files[weights.name][:12]}, got {found[:12]}"
                )
            return card
    raise InvalidInputError(f"'{weights}': no card in {CARDS} beside it names it")
