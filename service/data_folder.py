"""The data folder: made, held by one service at a time, and known to its child processes."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

from dohyo.evaluation.running.lock import held as folder_held
from dohyo.service.policies.agent import FOLDER_VARIABLE
from dohyo.service.settings import Settings
from dohyo.sumo_networks.errors import InvalidInputError


@contextmanager
def held(settings: Settings) -> Iterator[None]:
    """Makes the folder and keeps it: two services on one would drive the same episodes.

    Raises:
        InvalidInputError: It cannot be made, or another service holds it.
    """
    try:
        for folder in (settings.data, settings.records, settings.staging, settings.policies):
            folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    except OSError as error:
        raise InvalidInputError(f"data folder '{settings.data}' cannot be used: {error.strerror}") from error
    with folder_held(settings.data, "data folder"):
        yield


@contextmanager
def told(settings: Settings) -> Iterator[None]:
    """Tells this process and its children where networks and policies are."""
    ours = {"DOHYO_HOME": str(settings.data.resolve()), FOLDER_VARIABLE: str(settings.policies.resolve())}
    before = {name: os.environ.get(name) for name in ours}
    os.environ.update(ours)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
