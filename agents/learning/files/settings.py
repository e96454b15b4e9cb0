"""Settings: from a TOML file and the command line to a checked configuration, and back."""

from __future__ import annotations

import difflib
import json
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.errors import InvalidInputError

C = TypeVar("C", bound=Config)


def read_settings(kind: type[C], path: Path | None, overrides: Sequence[str] = ()) -> C:
    """A configuration from a file, changed by "key=value" (such as "ppo.learning_rate=3e-4").

    Args:
        kind: Class of the configuration.
        path: A TOML file; None: the defaults.
        overrides: Values are TOML, or plain words.

    Raises:
        InvalidInputError: The file is missing or no TOML, or a key is unknown, missing or has a wrong value.
    """
    document, where = ({}, "settings") if path is None else (_document(path), f"'{path}'")
    for override in overrides:
        key, equals, value = override.partition("=")
        if not equals or not key:
            raise InvalidInputError(f"expected --set key=value, got '{override}'")
        _put(document, key.strip().split("."), _value(value.strip()), override)
    try:
        return kind.model_validate(_completed(_defaults(kind), document))
    except ValidationError as error:
        raise InvalidInputError(f"{where}: {_reason(kind, error.errors())}") from error


def as_toml(config: Config) -> str:
    """Configuration as TOML, without fields that are None."""
    document = config.model_dump(mode="json", exclude_none=True)
    plain = [f"{key} = {_toml(value)}" for key, value in document.items() if not isinstance(value, dict)]
    tables = [_table([key], value) for key, value in document.items() if isinstance(value, dict)]
    return "\n".join([*plain, *tables]) + "\n"


def differences(old: Config, new: Config, free: frozenset[str]) -> list[str]:
    """Differences of two configurations, as "key = old, not new"; keys in `free` may differ."""
    before, after = flat(old.model_dump(mode="json")), flat(new.model_dump(mode="json"))
    return [
        f"{key} = {_shown(before.get(key))}, not {_shown(after.get(key))}"
        for key in dict.fromkeys([*before, *after])
        if key not in free and before.get(key) != after.get(key)
    ]


def flat(document: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested tables as one, with dotted keys."""
    rows: dict[str, Any] = {}
    for key, value in document.items():
        rows |= flat(value, f"{prefix}{key}.") if isinstance(value, dict) else {f"{prefix}{key}": value}
    return rows


def _document(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text())
    except OSError as error:
        raise InvalidInputError(f"cannot read '{path}': {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InvalidInputError(f"'{path}' is no TOML: {error}") from error


def _defaults(kind: type[BaseModel]) -> dict[str, Any]:
    return {name: field.get_default(call_default_factory=True) for name, field in kind.model_fields.items()}


def _completed(defaults: Mapping[str, Any], document: Mapping[str, Any]) -> dict[str, Any]:
    """Document in which each table, at any depth, is completed from the instance that is its default."""
    completed = dict(document)
    for name, default in defaults.items():
        given = document.get(name)
        if isinstance(default, BaseModel) and isinstance(given, dict):
            completed[name] = dict(default) | _completed(dict(default), given)
    return completed


def _put(document: dict[str, Any], keys: Sequence[str], value: Any, override: str) -> None:
    *tables, last = keys
    for table in tables:
        document = document.setdefault(table, {})
        if not isinstance(document, dict):
            raise InvalidInputError(f"--set {override}: '{table}' is no table")
    document[last] = value


def _value(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def _reason(kind: type[BaseModel], errors: Sequence[ErrorDetails]) -> str:
    # A misspelt key is missing and unknown; the latter says more.
    error = next((one for one in errors if one["type"] == "extra_forbidden"), errors[0])
    key = ".".join(map(str, error["loc"]))
    if error["type"] != "extra_forbidden":
        return f"{key}: {error['msg']}, got {error['input']!r}" if error["type"] != "missing" else f"{key} is missing"
    model: Any = kind
    for part in error["loc"][:-1]:
        field = model.model_fields.get(str(part)) if isinstance(model, type) and issubclass(model, BaseModel) else None
        model = None if field is None else field.annotation
    known = sorted(model.model_fields) if isinstance(model, type) and issubclass(model, BaseModel) else []
    near = difflib.get_close_matches(str(error["loc"][-1]), known, n=1)
    hint = f"; did you mean '{near[0]}'?" if near else ""
    return f"unknown key '{key}'{hint}" + (f" (there is {', '.join(known)})" if known else "")


def _table(path: list[str], table: Mapping[str, Any]) -> str:
    plain = [f"{key} = {_toml(value)}" for key, value in table.items() if not isinstance(value, dict)]
    inner = [_table([*path, key], value) for key, value in table.items() if isinstance(value, dict)]
    return "\n".join([f"\n[{'.'.join(path)}]", *plain, *inner])


def _toml(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(key)} = {_toml(inner)}" for key, inner in value.items()) + "}"
    return json.dumps(value, ensure_ascii=False)  # strings, numbers and booleans are equal in both


def _shown(value: Any) -> str:
    return "nothing" if value is None else _toml(value)
