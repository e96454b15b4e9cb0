"""The form of an import: an uploaded road file and the choices of `ImportOptions`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from dohyo.service.networks.finding import check_free
from dohyo.service.web.bodies.uploads import Upload, form_body
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.networks.conversion.countries import country_named
from dohyo.sumo_networks.networks.conversion.sources import file_suffix
from dohyo.sumo_networks.networks.parsing import file_hash

LICENCE_LENGTH: Final = 200
SIDES: Final = {"left": True, "right": False}
SWITCHES: Final = {"true": True, "false": False}


def _switch(description: str) -> dict[str, Any]:
    return {"type": "string", "enum": list(SWITCHES), "default": "false", "description": description}


FORM: Final = form_body(
    ["name"],
    {
        "name": {"type": "string", "pattern": "^[a-z0-9][a-z0-9-]{0,62}$", "examples": ["my-town"]},
        "lights": _switch("Guess lights at large junctions."),
        "side": {
            "type": "string",
            "enum": list(SIDES),
            "description": "Side of the traffic; default: as in the country, or as the file says.",
        },
        "country": {
            "type": "string",
            "pattern": "^[A-Za-z]{2}$",
            "description": "For OpenStreetMap files: side and speed limits; default: from the coordinates.",
        },
        "largest_part": _switch("Keep only roads that lead to each other."),
        "fix": _switch("Mend lights and implausible speed limits."),
        "licence": {"type": "string", "maxLength": LICENCE_LENGTH},
    },
)


def import_arguments(given: Upload) -> dict[str, Any]:
    """Arguments of a job of import.

    Raises:
        InvalidInputError: A field is invalid, or the file's name has an unknown ending.
        ConflictError: There is a network of this name.
        TooManyRequestsError: The catalog is full.
    """
    name, licence = given.fields.get("name", ""), given.fields.get("licence") or None
    check_free(name)
    if licence is not None and (len(licence) > LICENCE_LENGTH or not licence.isprintable()):
        raise InvalidInputError(f"licence: expected at most {LICENCE_LENGTH} printable characters")
    return {
        "name": name,
        "suffix": file_suffix(given.name),  # nothing else of the sender's file name is used
        "sha256": file_hash(given.path),
        "options": {
            "lights": _chosen(given.fields, "lights", SWITCHES, default="false"),
            "left_hand": _chosen(given.fields, "side", SIDES),
            "country": _country(given.fields.get("country")),
            "largest_part": _chosen(given.fields, "largest_part", SWITCHES, default="false"),
            "fix": _chosen(given.fields, "fix", SWITCHES, default="false"),
            "licence": licence,
        },
    }


def _country(code: str | None) -> str | None:
    try:
        return country_named(code).code if code else None
    except UnknownNameError as error:
        raise InvalidInputError(f"country: {error}") from error


def _chosen(fields: Mapping[str, str], key: str, choices: Mapping[str, bool], default: str = "") -> bool | None:
    """One of the choices; None: not given, and there is no default."""
    text = fields.get(key) or default
    if not text:
        return None
    if text not in choices:
        raise InvalidInputError(f"{key}: expected {' or '.join(choices)}, got {text[:40]!r}")
    return choices[text]
