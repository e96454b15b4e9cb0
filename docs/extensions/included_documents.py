"""Links of a document of the repository, where a page of the site includes that document.

README, CONTEXT and the systems' READMEs stand beside what they describe, and their links are relative to there. In the
page that includes them, a link to another included document leads to that document's page, a link to a page of the
site to that page, and a link to any other file becomes the file's name: the site is no copy of the repository.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

LINK = re.compile(r"(!?)\[([^\]]*)\]\(([^)\s#]+)(#[^)\s]*)?\)")
INCLUDE = re.compile(r"^```\{include\} (\S+)$", re.MULTILINE)
PAGES = "*.md"


def including_pages(docs: Path) -> dict[Path, Path]:
    """Page by the document that it includes, both as absolute paths."""
    return {
        (page.parent / name).resolve(): page for page in docs.rglob(PAGES) for name in INCLUDE.findall(page.read_text())
    }


def moved(source: str, document: Path, page: Path, docs: Path) -> str:
    """The document's text, its links as they are from the page.

    Args:
        source: The document's text.
        document: Absolute path of the document.
        page: Absolute path of the page that includes it.
        docs: Absolute path of the site's source folder.
    """
    pages = including_pages(docs)

    def link(match: re.Match[str]) -> str:
        image, words, name, anchor = match.groups()
        if re.match(r"\w+:", name):
            return match[0]
        target = (document.parent / name).resolve()
        if target in pages:
            target = pages[target]
        elif not image and not (target.suffix == ".md" and target.is_relative_to(docs)):
            return words if "`" in words or words == name else f"{words} (`{os.path.relpath(target, docs.parent)}`)"
        return f"{image}[{words}]({os.path.relpath(target, page.parent)}{anchor or ''})"

    return LINK.sub(link, source)


def on_include(app: Sphinx, path: Path, _: str, content: list[str]) -> None:
    """Replaces the text that is about to be included; MyST gives the including page without its folder."""
    docs = Path(app.srcdir).resolve()
    document = (docs / path).resolve()
    if not document.is_relative_to(docs):
        content[0] = moved(content[0], document, Path(app.env.doc2path(app.env.docname)).resolve(), docs)


def setup(app: Sphinx) -> dict[str, Any]:
    """Registers the extension."""
    app.connect("include-read", on_include)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
