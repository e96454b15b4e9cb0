"""Answers with files that may be deleted meanwhile."""

from __future__ import annotations

from typing import Any, BinaryIO

from starlette.responses import FileResponse
from starlette.types import Receive, Scope, Send


class OpenFileResponse(FileResponse):
    """Answer with an open file, so that its deletion does not cut the answer short; byte ranges are supported."""

    def __init__(self, file: BinaryIO, **options: Any) -> None:
        """Takes the file, and closes it after the answer."""
        super().__init__(f"/proc/self/fd/{file.fileno()}", **options)
        self._file = file

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Sends the file."""
        with self._file:
            await super().__call__(scope, receive, send)
