"""The data folder: created, locked by one service at a time, and passed to its child processes."""

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
    """Creates and locks the folder: two services on one folder would drive the same episodes.

    Raises:
        InvalidInputError: The folder cannot be created, or another service has locked it.
    """
    try:
        for folder in (settings.data, settings.records, settings.staging, settings.policies, settings.uploads):
            folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    except OSError as error:
        raise InvalidInputError(f"data folder '{settings.data}' cannot be used: {error.strerror}") from error
    with folder_held(settings.data, "data folder"):
        yield


@contextmanager
def told(settings: Settings) -> Iterator[None]:
    """Sets the environment variables by which this process and its children find networks and policies."""
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
