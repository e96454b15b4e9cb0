"""Uploads: multipart forms that hold one file, read to a temporary file under a limit."""

from __future__ import annotations

import os
import tempfile
from collections.abc import AsyncIterator, Iterator, Mapping
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fastapi import Request
from starlette.datastructures import FormData, UploadFile
from starlette.exceptions import HTTPException

from dohyo.service.errors import TooLargeError, TooManyRequestsError
from dohyo.service.state import Services
from dohyo.service.web.addresses import payer_of
from dohyo.service.web.bodies.strict_json import require_text
from dohyo.sumo_networks.errors import InvalidInputError

CHUNK = 1 << 20
FIELDS = 10
UNDER_WAY = 4  # uploads of one owner at once
RETRY_S = 10.0


@dataclass(frozen=True, slots=True)
class Upload:
    """One file and the form's other fields.

    Attributes:
        path: Path of the temporary file, which is deleted at the end of the request.
        name: File name given by the sender, without folders; never used as a path.
        fields: The other fields.
    """

    path: Path
    name: str
    fields: Mapping[str, str]


@asynccontextmanager
async def receive_upload(request: Request, limit: int) -> AsyncIterator[Upload]:
    """Reads the form of a request: the part `file`, and text fields.

    Args:
        request: Request with a body `multipart/form-data`.
        limit: Largest size of the file, bytes.

    Raises:
        InvalidInputError: The body is not such a form, or has not exactly one `file`.
        TooLargeError: The file is too large.
        TooManyRequestsError: Too many other uploads of the owner are under way.
        OSError: The disk is full.
    """
    if not request.headers.get("content-type", "").startswith("multipart/form-data"):
        raise InvalidInputError("expected a body of type multipart/form-data with a part 'file'")
    with _place(request):
        async with _received(request, limit) as upload:
            yield upload


@contextmanager
def _place(request: Request) -> Iterator[None]:
    """One of the owner's few places for uploads."""
    services: Services = request.app.state.services
    taken, payer = services.uploads, payer_of(request)
    if taken[payer] >= UNDER_WAY:
        raise TooManyRequestsError(f"at most {UNDER_WAY} uploads at once", RETRY_S)
    taken[payer] += 1
    try:
        yield
    finally:
        taken[payer] -= 1
        if not taken[payer]:
            del taken[payer]


@asynccontextmanager
async def _received(request: Request, limit: int) -> AsyncIterator[Upload]:
    form = await _form(request)
    try:
        file = _file(form)
        fields = {key: require_text(value, key) for key, value in form.multi_items() if isinstance(value, str)}
        name = os.path.basename((file.filename or "").replace("\\", "/"))
        with tempfile.TemporaryDirectory(prefix="dohyo-upload-") as folder:
            path = Path(folder) / "file"
            await _copy(file, path, limit)
            yield Upload(path, name, fields)
    finally:
        await form.close()


def form_body(required: list[str], properties: Mapping[str, Any]) -> dict[str, Any]:
    """The OpenAPI entry of a form with a part `file` and other fields."""
    file = {"file": {"type": "string", "format": "binary"}}
    schema = {"type": "object", "required": ["file", *required], "properties": {**file, **properties}}
    return {"requestBody": {"required": True, "content": {"multipart/form-data": {"schema": schema}}}}


async def _form(request: Request) -> FormData:
    try:
        return await request.form(max_files=1, max_fields=FIELDS, max_part_size=CHUNK)
    except HTTPException as error:
        if error.status_code != 400:
            raise
        raise InvalidInputError(f"the form cannot be read: {error.detail}") from error


def _file(form: FormData) -> UploadFile:
    files = [value for key, value in form.multi_items() if key == "file" and isinstance(value, UploadFile)]
    if len(files) != 1:
        raise InvalidInputError("expected one part 'file' with a file name")
    return files[0]


async def _copy(file: UploadFile, path: Path, limit: int) -> None:
    size = 0
    with path.open("wb") as target:
        while chunk := await file.read(CHUNK):
            size += len(chunk)
            if size > limit:
                raise TooLargeError(limit)
            target.write(chunk)
