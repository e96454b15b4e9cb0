"""How the documents read: short sentences, and a README that fits a page."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
MOST_WORDS = 30
MOST_LINES = 120
DOCUMENTS = sorted(
    path
    for path in (ROOT / "README.md", ROOT / "CONTEXT.md", *ROOT.glob("*/README.md"), *(ROOT / "docs").rglob("*.md"))
    if "{include}" not in path.read_text()
)
NOT_PROSE = re.compile(r"^(\||#|!\[|<|>|\s*$)|^\s*```")
LIST_ITEM = re.compile(r"^\s*([*-]|\d+\.)\s")
SENTENCE_END = re.compile(r"(?<=[.!?])[*_\"')]*\s+(?=[^a-z])")


def paragraphs(source: str) -> list[str]:
    """Running text and list items, without code blocks, tables, headings, pictures and quotes."""
    found: list[str] = []
    fenced = opened = False
    for line in source.splitlines():
        if line.lstrip().startswith("```"):
            fenced = not fenced
        if fenced or NOT_PROSE.match(line):
            opened = False
            continue
        if opened and not LIST_ITEM.match(line):
            found[-1] += f" {line.strip()}"
        else:
            found.append(LIST_ITEM.sub("", line).strip())
        opened = True
    return found


def sentences(source: str) -> list[str]:
    """Every sentence, a link counted by its words and code as one word."""
    plain = [re.sub(r"\]\([^)]*\)", "", re.sub(r"`[^`]+`", "CODE", one)) for one in paragraphs(source)]
    return [sentence for one in plain for sentence in SENTENCE_END.split(one)]


def long_sentences(source: str) -> list[str]:
    return [one for one in sentences(source) if len(re.findall(r"\w[\w'.,^/-]*", one)) > MOST_WORDS]


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_no_sentence_is_long(path: Path) -> None:
    assert long_sentences(path.read_text()) == []


def test_the_readme_is_a_page() -> None:
    assert len((ROOT / "README.md").read_text().splitlines()) <= MOST_LINES


def test_what_counts_as_a_long_sentence() -> None:
    words = " ".join(["word"] * 30)
    assert long_sentences(f"{words}. {words.capitalize()}.") == []
    assert long_sentences(f"A {words}.\n\n* {words}\n  and more.") != []
    assert len(long_sentences(f"* {words}\n* {words} `one code`\n")) == 1
    assert long_sentences(f"| {words} | {words} |\n\n```\n{words} {words}\n```\n") == []
    assert long_sentences(f"{words[5:]} [a link](with/words.md)") != []
