"""Generates the blocking client from the asynchronous one, and the types of both from the service's description.

    python -m dohyo.service.client.generate

The clients differ only in the words of asyncio; a word of the table below is replaced wherever it stands.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Final

from dohyo.service.client.answer_types import answer_types

SOURCE: Final = Path(__file__).with_name("async_client.py")
TARGET: Final = Path(__file__).with_name("client.py")
ANSWERS: Final = Path(__file__).with_name("answers.py")
NOTE: Final = "# Generated from async_client.py by `python -m dohyo.service.client.generate`: edit that file.\n"
PHRASES: Final = {
    r"await asyncio\.to_thread\(([\w.]+)(?:, )?": r"\1(",
    r"async (def|for|with) ": r"\1 ",
    r"await ": "",
    r"AsyncGenerator\[(\w+), None\]": r"Generator[\1, None, None]",
    r"AsyncClient: access to the service from Python with asyncio": "Client: access to the service from Python",
    r"import asyncio\n": "",
}
WORDS: Final = {
    "AsyncClient": "Client",
    "AsyncGenerator": "Generator",
    "AsyncIterator": "Iterator",
    "__aenter__": "__enter__",
    "__aexit__": "__exit__",
    "aclose": "close",
    "aclosing": "closing",
    "aiter_bytes": "iter_bytes",
    "aiter_lines": "iter_lines",
    "aread": "read",
    "asyncio.sleep": "time.sleep",
}


def blocking(source: str) -> str:
    """The code of the blocking client."""
    for pattern, replacement in PHRASES.items():
        source = re.sub(pattern, replacement, source)
    for word, replacement in WORDS.items():
        source = re.sub(rf"\b{re.escape(word)}\b", replacement, source)
    return NOTE + source


def _description() -> dict[str, Any]:
    from dohyo.service.app import create_app
    from dohyo.service.settings import Settings

    return create_app(Settings(_env_file=None)).openapi()


if __name__ == "__main__":
    ANSWERS.write_text(answer_types(_description()))
    TARGET.write_text(blocking(SOURCE.read_text()))
