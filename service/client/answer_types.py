"""Answer types: the documents of the interface as TypedDicts, from its OpenAPI description."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any, Final

ANSWERS: Final = (
    "AgentView",
    "SubmissionView",
    "EvaluationView",
    "EpisodeView",
    "MetricsView",
    "LeaderboardView",
    "ComparedView",
    "CrossPlayView",
    "WorldView",
    "WorldInvitationView",
    "WorldGuestView",
)
"""Schemas of the client's answers; those that they refer to follow."""

PLAIN: Final = {"string": "str", "integer": "int", "number": "float", "boolean": "bool", "null": "None"}
HEAD: Final = '''# Generated from the service's OpenAPI description by `python -m dohyo.service.client.generate`.
"""Answers of the service, as plain JSON."""

from __future__ import annotations

from typing import Any, Literal, NotRequired, TypedDict
'''


def answer_types(openapi: Mapping[str, Any]) -> str:
    """Code of a module with a TypedDict for each answer by name, and after them the enumerations."""
    schemas = openapi["components"]["schemas"]
    wanted, found = list(ANSWERS), set[str]()
    while wanted:
        name = wanted.pop()
        if name not in found:
            found.add(name)
            wanted += _references(schemas[name])
    ordered = sorted(found, key=lambda name: ("properties" not in schemas[name], name))
    return HEAD + "".join(_definition(name, schemas[name]) for name in ordered)


def _definition(name: str, schema: Mapping[str, Any]) -> str:
    if "properties" not in schema:
        return f"\n\n{name} = {_type(schema)}\n"
    lines = [f'\n\nclass {name}(TypedDict):\n    """{schema["description"].splitlines()[0]}"""\n']
    for key, value in schema["properties"].items():
        kind = _type(value)
        lines.append(f"\n    {key}: {kind if key in schema.get('required', ()) else f'NotRequired[{kind}]'}")
    return "".join([*lines, "\n"])


def _type(schema: Mapping[str, Any]) -> str:
    """Python type of a value."""
    if "$ref" in schema:
        return _name(schema["$ref"])
    if "anyOf" in schema:
        return " | ".join(dict.fromkeys(map(_type, schema["anyOf"])))
    if "const" in schema or "enum" in schema:
        return f"Literal[{', '.join(repr(one) for one in schema.get('enum', [schema.get('const')]))}]".replace("'", '"')
    if schema.get("type") == "array":
        return f"list[{_type(schema.get('items', {}))}]"
    if schema.get("type") == "object":
        values = schema.get("additionalProperties")
        return f"dict[str, {_type(values) if isinstance(values, dict) else 'Any'}]"
    return PLAIN.get(schema.get("type", ""), "Any")


def _name(reference: str) -> str:
    return re.sub(r"\W", "_", reference.rpartition("/")[2])


def _references(value: Any) -> Iterator[str]:
    """Names of the schemas that a part of a description refers to."""
    if isinstance(value, Mapping):
        if "$ref" in value:
            yield _name(value["$ref"])
        for one in value.values():
            yield from _references(one)
    elif isinstance(value, list):
        for one in value:
            yield from _references(one)
