"""Faults of a document in words: where, what was expected, and what came, from the errors of pydantic."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Final, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

_WORDS: Final[Mapping[str, str]] = {
    **dict.fromkeys(("tuple_type", "list_type"), "a list"),
    **dict.fromkeys(("dict_type", "model_type", "model_attributes_type"), "a table"),
    **dict.fromkeys(("int_type", "int_parsing", "int_from_float"), "a whole number"),
    **dict.fromkeys(("float_type", "float_parsing"), "a number"),
    **dict.fromkeys(("bool_type", "bool_parsing"), "true or false"),
    "string_type": "text",
    "string_pattern_mismatch": "text that matches {pattern}",
    "greater_than": "above {gt}",
    "greater_than_equal": "at least {ge}",
    "less_than": "below {lt}",
    "less_than_equal": "at most {le}",
    "too_short": "a list with {min_length} or more entries",
    "union_tag_not_found": "a table with {discriminator}",
    "union_tag_invalid": "{discriminator} to be one of {expected_tags}",
}
"""What was expected, by pydantic's type of an error; the words are those of an agent's settings."""
_FORMS: Final[Mapping[str, str]] = {
    r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,99}$": (
        "up to 100 letters, digits, '_', '.' and '-' that begin with a letter or a digit"
    ),
}
"""Text of a pattern, in words."""
_LONGEST: Final = 60
_ALIKE: Final = 0.75
"""Smallest likeness of two keys, of which one may be meant by the other."""


def describe_fault(
    error: ValidationError,
    model: type[BaseModel],
    document: Mapping[str, Any] | None = None,
    more_keys: Iterable[str] = (),
) -> str:
    """The first fault of a document, such as "traffic.vehicle: unknown key; did you mean 'vehicles'?".

    Args:
        error: Error of the validation.
        model: Class of valid documents.
        document: Document as its author wrote it, from which the validated one was made; None: the same.
        more_keys: Keys that it may have beside the fields of the class.
    """
    faults = error.errors(include_url=False)
    # A misspelt key is missing and unknown; the latter says more.
    first = next((one for one in faults if one["type"] == "extra_forbidden"), faults[0])
    place = first["loc"] if document is None else _place_in(document, first["loc"], first["type"] == "missing")
    where = ".".join(map(str, place))
    if first["type"] == "extra_forbidden":
        *above, key = first["loc"]
        told = _unknown(str(key), {*_fields_at(model, above), *(() if above else more_keys)})
    else:
        told = _expected(first)
    return f"{where}: {told}" if where else told


def _unknown(key: str, known: Iterable[str]) -> str:
    near = difflib.get_close_matches(key, sorted(known), n=1, cutoff=_ALIKE)
    hint = f"; did you mean '{near[0]}'?" if near else ""
    return f"unknown key{hint} (there is {', '.join(sorted(known))})"


def _expected(one: ErrorDetails) -> str:
    """What was expected, and what came."""
    context = one.get("ctx", {})
    match one["type"]:
        case "missing":
            return "expected a value, and there is none"
        case "json_invalid":
            return f"expected JSON, but {context['error']}"
        case "value_error":
            return str(context["error"])  # a validator of dohyo, whose messages are whole
        case "string_pattern_mismatch" if context["pattern"] in _FORMS:
            expected = _FORMS[context["pattern"]]
        case kind if kind in _WORDS:
            expected = _WORDS[kind].format(**context)
        case _:
            expected = one["msg"].removeprefix("Input should be ")
    got = repr(context.get("tag", one["input"]))
    return f"expected {expected}, got {got if len(got) <= _LONGEST else f'{got[:_LONGEST]}...'}"


def _place_in(document: Any, place: Sequence[int | str], missing: bool) -> list[int | str]:
    """The parts of a place that a document has; others name cells of a short form, or kinds of a union.

    Args:
        document: Document.
        place: Place in the validated one.
        missing: Whether the last part is what is missing.
    """
    found: list[int | str] = []
    for part in place[:-1] if missing else place:
        inside = isinstance(document, Mapping) and part in document
        if inside or (isinstance(document, list | tuple) and isinstance(part, int) and part < len(document)):
            document = document[part]
            found.append(part)
    return [*found, place[-1]] if missing else found


def _fields_at(model: type[BaseModel], place: Sequence[int | str]) -> set[str]:
    """Names of the fields at a place of a valid document."""
    models = [model]
    for part in place:
        fields = [one.model_fields[str(part)] for one in models if str(part) in one.model_fields]
        inner = [found for field in fields for found in _models_in(field.annotation)]
        # Where the part is no field, it is an index, a key, or the kind of one model of a union.
        models = inner or [one for one in models if _kind(one) == part] or models
    return {name for one in models for name in one.model_fields}


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    """All models in a type: itself, its elements, or the members of a union."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    else:
        for part in get_args(annotation):
            yield from _models_in(part)


def _kind(model: type[BaseModel]) -> Any:
    return model.model_fields["kind"].default if "kind" in model.model_fields else None
