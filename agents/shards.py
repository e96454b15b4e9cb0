"""Datasets in shards: one compressed .npz file per episode, and a file with the dataset's order."""

from __future__ import annotations

import io
import json
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import write_atomically

Arrays = dict[str, NDArray[Any]]


def pack_shard(version: int, arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """Bytes of a shard; the same arrays give the same bytes."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, schema=np.int32(version), **arrays)  # type: ignore[arg-type]
    return buffer.getvalue()


def read_shard(path: Path, kind: str, version: int, names: set[str]) -> Arrays:
    """Arrays of a file.

    Args:
        path: Of the shard.
        kind: Kind of dataset, for error messages.
        version: Of its schema.
        names: Of its arrays.

    Raises:
        InvalidInputError: The file is missing, damaged, or of another schema.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
    except FileNotFoundError as error:
        raise InvalidInputError(f"no {kind} shard '{path}'") from error
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile, zlib.error) as error:
        raise InvalidInputError(f"{kind} shard '{path}' is damaged: {error}; record it again") from error
    found = arrays.pop("schema", None)
    if found is None or found.shape != () or int(found) != version:
        raise InvalidInputError(f"{kind} shard '{path}': expected schema {version}, got {found}")
    if set(arrays) != names:
        raise InvalidInputError(f"{kind} shard '{path}': wrong arrays: {sorted(names ^ set(arrays))}")
    return arrays


def check_array(path: Path, kind: str, name: str, array: NDArray[Any], shape: tuple[int, ...], dtype: str) -> None:
    """Raises InvalidInputError if an array differs from the schema's shape and dtype, or contains NaN or infinity."""
    if array.shape != shape or array.dtype != dtype:
        raise InvalidInputError(
            f"{kind} shard '{path}': expected {name} as {dtype} {shape}, got {array.dtype} {array.shape}"
        )
    if dtype == "float32" and not np.isfinite(array).all():
        raise InvalidInputError(f"{kind} shard '{path}': {name} holds NaN or infinity")


def find_shards(folder: Path, split: str, kind: str) -> list[Path]:
    """The shards of one split ("train", "validation", "test"), sorted.

    Raises:
        InvalidInputError: There are none.
    """
    found = sorted((folder / split).glob("*.npz"))
    if not found:
        raise InvalidInputError(f"expected {kind} shards in '{folder / split}', found none (dohyo dataset {kind})")
    return found


def claim_folder(out: Path, document: Mapping[str, Any]) -> None:
    """Writes dataset.json, or checks that the existing one is equal.

    Raises:
        InvalidInputError: The file is damaged, or has another order.
    """
    path = out / "dataset.json"
    if not path.exists():
        out.mkdir(parents=True, exist_ok=True)
        write_atomically(path, (json.dumps(document, indent=1) + "\n").encode())
        return
    try:
        there = json.loads(path.read_text())
    except ValueError as error:
        raise InvalidInputError(f"'{path}' is damaged: {error}") from error
    if there != document:
        raise InvalidInputError(f"'{out}': expected a dataset made with {document}, got {there}")
