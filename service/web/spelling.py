"""How names are spelled in requests: patterns, and each in words, which errors tell in place of the pattern."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

ID: Final = r"^[A-Za-z0-9_-]+$"
AGENT_NAME: Final = r"^[A-Za-z0-9][A-Za-z0-9._-]*$"
ACTOR_NAME: Final = r"^[A-Za-z0-9][A-Za-z0-9_.:-]*$"
BENCHMARK_NAME: Final = r"^[A-Za-z0-9._-]+$"
OWNER_NAME: Final = r"^[A-Za-z0-9][A-Za-z0-9._@-]*$"
TEAM_NAME: Final = r"^[A-Za-z0-9](?: ?[A-Za-z0-9._-])*$"
CHALLENGE_NAME: Final = r"^[a-z0-9][a-z0-9-]*$"
VERSION_HASH: Final = r"^[0-9a-f]{8,64}$"
SHA256: Final = r"^([0-9a-f]{64})?$"

_FIRST: Final = "with a letter or a digit first"
IN_WORDS: Final[Mapping[str, str]] = MappingProxyType(
    {
        ID: "letters of ASCII, digits, '_' and '-'",
        AGENT_NAME: f"letters of ASCII, digits, '.', '_' and '-', {_FIRST}",
        ACTOR_NAME: f"letters of ASCII, digits, '_', '.', ':' and '-', {_FIRST}",
        BENCHMARK_NAME: "letters of ASCII, digits, '.', '_' and '-'",
        OWNER_NAME: f"letters of ASCII, digits, '.', '_', '@' and '-', {_FIRST}",
        TEAM_NAME: f"letters of ASCII, digits, single spaces, '.', '_' and '-', {_FIRST} and no space at the end",
        CHALLENGE_NAME: f"small letters of ASCII, digits and '-', {_FIRST}",
        VERSION_HASH: "8 to 64 hexadecimal digits, in small letters",
        SHA256: "64 hexadecimal digits, in small letters",
    }
)


def expected_spelling(pattern: str) -> str:
    """What a pattern asks for, in words where there are some."""
    return f"expected {IN_WORDS[pattern]}" if pattern in IN_WORDS else f"expected text that matches {pattern!r}"
