"""Settings of an agent: the signature of its constructor is their schema, with types, ranges and defaults.

def __init__(self, throttle: Annotated[float, Field(ge=0, le=1)] = 0.5) -> None: ...
def __init__(self, filter: Annotated[str, OneOf(FILTERS)] = "es-ekf") -> None: ...
def __init__(self, **style: Annotated[float, FieldsOf(Style)]) -> None: ...
"""

from __future__ import annotations

import difflib
import inspect
import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, is_dataclass
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

from pydantic import BaseModel, ConfigDict, Field, GetCoreSchemaHandler, TypeAdapter, ValidationError, create_model
from pydantic.errors import PydanticUserError
from pydantic_core import CoreSchema, core_schema

from dohyo.sumo_networks.errors import InvalidInputError

Schema = Mapping[str, Any]
"""A JSON Schema of an object."""
UNKNOWN = "unknown"

_RULES = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, arbitrary_types_allowed=True)
_KEPT = ("type", "enum", "format", "default", "description", "anyOf", "items", "prefixItems", "additionalProperties",
         "minimum", "exclusiveMinimum", "maximum", "exclusiveMaximum", "multipleOf", "minLength", "maxLength",
         "minItems", "maxItems", "pattern")  # fmt: skip
_CONSTRAINTS = {"minimum": "ge", "exclusiveMinimum": "gt", "maximum": "le", "exclusiveMaximum": "lt",
                "multipleOf": "multiple_of", "minLength": "min_length", "maxLength": "max_length",
                "minItems": "min_length", "maxItems": "max_length", "pattern": "pattern"}  # fmt: skip
_TYPES: Mapping[str, Any] = {"number": float, "integer": int, "boolean": bool, "string": str, "null": None,
                             "object": dict[str, Any]}  # fmt: skip
_WORDS = {"number": "a number", "integer": "a whole number", "boolean": "true or false", "string": "text",
          "null": "null", "array": "a list", "object": "an object"}  # fmt: skip
_BOUNDS = {"exclusiveMinimum": "above {}", "minimum": "at least {}", "exclusiveMaximum": "below {}",
           "maximum": "at most {}", "multipleOf": "a multiple of {}"}  # fmt: skip


@dataclass(frozen=True, slots=True)
class OneOf:
    """Restricts a text setting to the names of a registry, as in `Annotated[str, OneOf(FILTERS)]`."""

    names: Iterable[str]

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Schema of a literal."""
        return core_schema.literal_schema(list(self.names))


@dataclass(frozen=True, slots=True)
class FieldsOf:
    """Declares that `**settings` are the fields of a dataclass or pydantic model."""

    fields: type


class SettingsError(InvalidInputError):
    """Settings that an agent does not take.

    Attributes:
        faults: What was expected and what came, by the setting's name.
    """

    def __init__(self, what: str, faults: Mapping[str, str], known: Iterable[str]) -> None:
        told = "; ".join(f"setting '{name}': {fault}" for name, fault in faults.items())
        unknown = any(fault.startswith(UNKNOWN) for fault in faults.values())
        valid = f" (its settings are {', '.join(sorted(known)) or 'none'})" if unknown else ""
        super().__init__(f"{what}: {told}{valid}")
        self.faults = dict(faults)


def settings_schema(maker: Callable[..., Any]) -> Schema:
    """JSON Schema of a constructor's arguments; `additionalProperties` is true if it takes any others."""
    return _schema_of(_model_of(maker))


def check_settings(maker: Callable[..., Any], what: str, settings: Mapping[str, Any]) -> None:
    """Checks settings against the signature of a constructor.

    Args:
        maker: The constructor.
        what: Words for it in messages, such as "agent 'autopilot'".
        settings: Its arguments by name.

    Raises:
        SettingsError: Some are unknown, missing, of another type, or out of range; the message names all of them.
    """
    try:
        inspect.signature(maker)
    except (TypeError, ValueError):
        return  # a constructor without a signature: the call decides
    _check(_model_of(maker), what, settings)


def check_against(schema: Schema, what: str, settings: Mapping[str, Any]) -> None:
    """Checks settings against a stored schema, without the class.

    Raises:
        SettingsError: As for `check_settings`.
    """
    needed = schema.get("required", ())
    fields: dict[str, Any] = {
        f"field_{number}": (
            _type_of(one),
            Field(... if name in needed else one.get("default"), alias=name, json_schema_extra=dict(one)),
        )
        for number, (name, one) in enumerate(schema.get("properties", {}).items())
    }
    extra: Literal["allow", "forbid"] = "allow" if schema.get("additionalProperties") else "forbid"
    _check(create_model("Settings", __config__=_RULES | {"extra": extra}, **fields), what, settings)


def names_a_path(setting: Schema) -> bool:
    """Whether a setting is a path of the machine on which the agent runs."""
    return setting.get("format") == "path" or any(names_a_path(one) for one in setting.get("anyOf", ()))


def _check(model: type[BaseModel], what: str, settings: Mapping[str, Any]) -> None:
    try:
        given = json.dumps(settings, allow_nan=False)
    except (TypeError, ValueError, RecursionError):
        given = None  # objects of a caller in Python: as they are
    try:
        if given is None:
            model.model_validate(dict(settings), strict=False)
        else:
            model.model_validate_json(given)
    except ValidationError as error:
        schema = _schema_of(model)
        raise SettingsError(what, dict(_faults(error, schema, settings)), schema["properties"]) from error


def _faults(error: ValidationError, schema: Schema, settings: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Each wrong setting with its fault."""
    known = schema["properties"]
    for one in error.errors(include_url=False, include_context=False):
        name = str(one["loc"][0]) if one["loc"] else "settings"
        if one["type"] == "extra_forbidden":
            near = difflib.get_close_matches(name, known, n=1)
            yield name, f"{UNKNOWN}, did you mean '{near[0]}'?" if near else UNKNOWN
        elif one["type"] == "missing":
            yield name, f"expected {expected(known[name]) or 'a value'}, got nothing"
        else:
            came = settings.get(name, one["input"])
            yield name, f"expected {expected(known.get(name, {})) or one['msg']}, got {_short(came)}"


def expected(setting: Schema) -> str:
    """What a setting takes, in words: "a number, above 0, at most 60"."""
    if "anyOf" in setting:
        return " or ".join(dict.fromkeys(expected(one) for one in setting["anyOf"]))
    if "enum" in setting:
        return "one of " + ", ".join(map(repr, setting["enum"]))
    if "type" not in setting:
        return ""
    bounds = [words.format(f"{setting[key]:g}") for key, words in _BOUNDS.items() if key in setting]
    lengths = [words.format(setting[key]) for key, words in (("minLength", "at least {} characters"), ("maxLength",
               "at most {} characters")) if key in setting]  # fmt: skip
    return ", ".join([_WORDS[setting["type"]], *bounds, *lengths])


def _model_of(maker: Callable[..., Any]) -> type[BaseModel]:
    """Model with one field for each argument of a constructor."""
    fields: dict[str, Any] = {}
    extra: Literal["allow", "forbid"] = "forbid"
    for parameter, hint, text in _parameters(maker):
        if parameter.kind is parameter.VAR_KEYWORD:
            extra = "allow"
            continue
        default = ... if parameter.default is parameter.empty else parameter.default
        named = Field(default, alias=parameter.name, description=text)
        fields[f"field_{len(fields)}"] = (hint if _is_usable(hint) else Any, named)
    return create_model("Settings", __config__=_RULES | {"extra": extra}, **fields)


def _parameters(maker: Callable[..., Any]) -> list[tuple[inspect.Parameter, Any, str | None]]:
    """Arguments that can be given by name, with their types and descriptions; those of `FieldsOf` last."""
    if isinstance(maker, type) and not _has_constructor(maker):
        return []
    hints, texts = _hints(maker), _descriptions(maker)
    own, rest = [], []
    for one in _signature(maker).parameters.values():
        hint = hints.get(one.name, Any)
        if one.kind is one.VAR_KEYWORD and (fields := _fields_of(hint)):
            rest = _parameters(fields)
        elif one.kind in (one.POSITIONAL_OR_KEYWORD, one.KEYWORD_ONLY, one.VAR_KEYWORD):
            own.append((one, hint, texts.get(one.name)))
    names = {one.name for one, _, _ in own}
    return own + [one for one in rest if one[0].name not in names]


def _has_constructor(kind: type) -> bool:
    """Whether a class has a constructor of its own; that of a protocol takes no settings."""
    init: Any = getattr(kind, "__init__")  # noqa: B009
    inherited = init is object.__init__ or getattr(init, "__module__", None) == "typing"
    return not inherited or getattr(kind, "__new__") is not object.__new__  # noqa: B009


def _signature(maker: Callable[..., Any]) -> inspect.Signature:
    if isinstance(maker, type) and issubclass(maker, BaseModel):
        maker.model_rebuild()  # before, its signature is of any keywords
    return inspect.signature(maker)


def _hints(maker: Callable[..., Any]) -> Mapping[str, Any]:
    """Types of arguments; none if one of them cannot be evaluated, such as a name imported for type checkers only."""
    typed: Any = maker
    if isinstance(maker, type) and not issubclass(maker, BaseModel) and not is_dataclass(maker):
        typed = getattr(maker, "__init__")  # noqa: B009
    try:
        return get_type_hints(typed, include_extras=True)
    except (NameError, TypeError, AttributeError):
        return {}


def _fields_of(hint: Any) -> type | None:
    marks = get_args(hint)[1:] if get_origin(hint) is Annotated else ()
    return next((one.fields for one in marks if isinstance(one, FieldsOf)), None)


def _is_usable(hint: Any) -> bool:
    """Whether pydantic can check a type, and describe it as JSON."""
    try:
        TypeAdapter(hint, config=ConfigDict(arbitrary_types_allowed=True)).json_schema()
    except (PydanticUserError, TypeError, NameError):
        return False
    except AttributeError:
        return True  # a config cannot be given for a model or dataclass
    return True


def _descriptions(maker: Callable[..., Any]) -> dict[str, str]:
    """Description of each argument in the Google docstring of a class or of its constructor."""
    texts: dict[str, str] = {}
    for doc in (inspect.getdoc(maker), inspect.getdoc(getattr(maker, "__init__", None))):
        section = re.search(r"^(?:Args|Attributes):\n((?:[ ]+.*\n?|\n)+)", doc or "", re.MULTILINE)
        for name, text in re.findall(r"^ {4}(\w+): ((?:.+\n?)(?: {8}.*\n?)*)", section[1] if section else "", re.M):
            texts[name] = " ".join(text.split())
    return texts


def _schema_of(model: type[BaseModel]) -> Schema:
    """JSON Schema of a model, without titles and with the chosen keys alone."""
    whole = model.model_json_schema(by_alias=True)
    definitions = whole.get("$defs", {})
    properties = {name: _plain(one, definitions) for name, one in whole.get("properties", {}).items()}
    return {
        "type": "object",
        "properties": properties,
        "required": sorted(whole.get("required", ())),
        "additionalProperties": bool(whole.get("additionalProperties")),
    }


def _plain(one: Schema, definitions: Schema) -> dict[str, Any]:
    """One property without references to definitions."""
    if "$ref" in one:
        one = {**definitions[one["$ref"].rpartition("/")[2]], **one}
    if "const" in one:
        one = {**one, "enum": [one["const"]]}
    out = {key: one[key] for key in _KEPT if key in one}
    if names_a_path(out):
        out.pop("default", None)  # a place on one machine
    if "anyOf" in out:
        out["anyOf"] = [_plain(part, definitions) for part in out["anyOf"]]
    return out


def _type_of(setting: Schema) -> Any:
    """Type of a property of a stored schema."""
    if "anyOf" in setting:
        parts: Sequence[Any] = [_type_of(one) for one in setting["anyOf"]]
        union = parts[0]
        for part in parts[1:]:
            union |= part
        return union
    if "enum" in setting:
        return Annotated[str, OneOf(setting["enum"])]
    if "type" not in setting:
        return Any
    kind = list[Any] if setting["type"] == "array" else _TYPES[setting["type"]]
    limits = {word: setting[key] for key, word in _CONSTRAINTS.items() if key in setting}
    return Annotated[kind, Field(**limits)] if limits else kind


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
