"""Entry: loads an object of any module by "module:name"; each error is one line."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import Any

from dohyo.evaluation.settings import check_settings
from dohyo.sumo_networks.errors import DohyoError, InvalidInputError


def load_entry(entry: str, what: str) -> Any:
    """Loads the object that "module:name" names.

    Args:
        entry: Module and the name in it.
        what: Word for the object in messages, such as "agent".

    Raises:
        InvalidInputError: Not of this form, a module that cannot be imported, or no such name in it.
    """
    module_name, _, name = entry.partition(":")
    if not module_name or not name:
        raise InvalidInputError(f"{what} '{entry}': expected a registered name or 'module:name'")
    try:
        module = import_module(module_name)
    except (Exception, SystemExit) as error:  # a foreign module may raise anything when it is loaded
        raise InvalidInputError(
            f"{what} '{entry}' cannot be made: module '{module_name}' cannot be imported: {_cause(error)}"
        ) from error
    if not hasattr(module, name):
        raise InvalidInputError(f"{what} '{entry}' cannot be made: module '{module_name}' has no '{name}'")
    return getattr(module, name)


def make_entry(entry: str, what: str, settings: Mapping[str, Any]) -> Any:
    """Calls the object that "module:name" names, with the settings as keyword arguments.

    Raises:
        InvalidInputError: As for `load_entry`; or the call fails.
        SettingsError: Settings are unknown, of another type, or out of range.
    """
    maker = load_entry(entry, what)
    check_settings(maker, f"{what} '{entry}'", settings)
    try:
        return maker(**settings)
    except DohyoError as error:
        raise InvalidInputError(f"{what} '{entry}' cannot be made: {error}") from error
    except (Exception, SystemExit) as error:
        raise InvalidInputError(f"{what} '{entry}' cannot be made: {_cause(error)}") from error


def _cause(error: BaseException) -> str:
    """Type and first line of an error."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return ": ".join([type(error).__name__, *lines[:1]])
