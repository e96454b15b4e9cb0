"""RESULTS.md of a system: a page whose tables are written by commands, each between its own pair of marks.

<!-- begin val14 -->
| arm | score |
<!-- end val14 -->
"""

from __future__ import annotations

from pathlib import Path

from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import write_atomically

PAGE = "RESULTS.md"


def write_section(page: Path, section: str, markdown: str) -> None:
    """Replaces what stands between the marks of one section.

    Raises:
        InvalidInputError: The page does not have the two marks.
    """
    begin, end = f"<!-- begin {section} -->", f"<!-- end {section} -->"
    text = page.read_text()
    before, found_begin, rest = text.partition(begin)
    _, found_end, after = rest.partition(end)
    if not (found_begin and found_end):
        raise InvalidInputError(f"'{page}': expected the marks {begin} and {end}")
    write_atomically(page, f"{before}{begin}\n{markdown.strip()}\n{end}{after}".encode())
