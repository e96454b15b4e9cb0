"""Feature cache: the outputs of a frozen encoder over a data set of pictures, computed once and memory-mapped.

    features = cached_features(encoder, drives.column("camera_rgb"), Path("data/features"))
    features[rows]                                       # (N, F) float32

The file's name is a digest of the encoder's layers and weights, of the data, and of the preparation: a change of any
makes other features, and none of them is ever out of date. An interrupted computation goes on where it stopped.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch
from filelock import FileLock
from numpy.typing import NDArray
from torch import Tensor, nn

from dohyo.agents.perception.encoders.base import Encoder
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import write_atomically

Prepare = Callable[[Tensor], Tensor]


class Pictures(Protocol):
    """A data set of pictures: a `drives.Column`, or `drives.Column.of` an array.

    Attributes:
        digest: Names the values.
    """

    @property
    def digest(self) -> str:
        """See the class."""

    def __len__(self) -> int: ...

    def __getitem__(self, rows: slice, /) -> NDArray[Any]:
        """(N, C, H, W) some pictures."""


def cached_features(
    encoder: Encoder,
    pictures: Pictures,
    folder: Path,
    prepare: Prepare | None = None,
    batch: int = 64,
    progress: Callable[[int], None] = lambda rows: None,
    dtype: type[np.floating[Any]] = np.float32,
) -> NDArray[Any]:
    """Features of all pictures; computed only where the folder does not hold them.

    Two processes that want the same features compute them once: the second one waits.

    Args:
        encoder: Used in evaluation, on the device of its weights.
        pictures: What the encoder reads, after `prepare`.
        folder: Of the cache.
        prepare: What happens to a batch before the encoder, such as a change of size. Its `repr` is part of the digest
            and must give its settings: a frozen dataclass with `__call__`, or a module.
        batch: Pictures at once.
        progress: Called with the number of pictures done, after every batch.
        dtype: Of the stored features; np.float16 halves the file.

    Returns:
        (N, F) of that type, memory-mapped, read-only.

    Raises:
        InvalidInputError: There are no pictures, the `repr` of `prepare` does not give its settings, or a file of the
            cache is damaged.
    """
    if not len(pictures):
        raise InvalidInputError("expected pictures to compute features of, got none")
    suffix = "" if dtype is np.float32 else f"-{np.dtype(dtype).name}"
    path = folder / f"{features_digest(encoder, pictures, prepare)}{suffix}.npy"
    shape = (len(pictures), encoder.features)
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        with FileLock(path.with_suffix(".lock")):
            if not path.exists():
                _compute(encoder, pictures, prepare, batch, path, progress, dtype)
    try:
        features: NDArray[Any] = np.load(path, mmap_mode="r")
    except (OSError, ValueError, EOFError) as error:
        raise InvalidInputError(f"features '{path}' are damaged: {error}; remove the file") from error
    if features.shape != shape or features.dtype != dtype:
        raise InvalidInputError(
            f"features '{path}': expected {np.dtype(dtype)} {shape}, got {features.dtype} {features.shape}"
        )
    return features


def features_digest(encoder: nn.Module, pictures: Pictures, prepare: Prepare | None = None) -> str:
    """SHA-256 of the encoder's layers and weights, of the data, and of the preparation.

    Raises:
        InvalidInputError: The `repr` of `prepare` does not give its settings.
    """
    if re.search(r" at 0x[0-9a-f]+", repr(prepare)):
        raise InvalidInputError(
            f"expected a preparation whose repr gives its settings, such as a frozen dataclass, got {prepare!r}"
        )
    digest = hashlib.sha256(f"{encoder!r}\n{prepare!r}\n{pictures.digest}\n{len(pictures)}".encode())
    for name, tensor in encoder.state_dict().items():
        digest.update(f"{name} {tensor.dtype} {tuple(tensor.shape)}".encode())
        digest.update(tensor.detach().cpu().contiguous().numpy().tobytes())
    return digest.hexdigest()


def _compute(
    encoder: Encoder,
    pictures: Pictures,
    prepare: Prepare | None,
    batch: int,
    path: Path,
    progress: Callable[[int], None],
    dtype: type[np.floating[Any]],
) -> None:
    """Computes in batches into a draft, which gets its name when it is complete."""
    draft, marker = path.with_suffix(".part.npy"), path.with_suffix(".json")
    done = _rows_done(draft, marker, (len(pictures), encoder.features))
    features = np.lib.format.open_memmap(
        draft, "r+" if done else "w+", dtype, None if done else (len(pictures), encoder.features)
    )
    device, training = next(encoder.parameters()).device, encoder.training
    encoder.eval()
    try:
        with torch.inference_mode():
            for start in range(done, len(pictures), batch):
                part = torch.from_numpy(np.ascontiguousarray(pictures[start : start + batch])).to(device)
                features[start : start + len(part)] = encoder(prepare(part) if prepare else part).float().cpu().numpy()
                features.flush()  # before the marker counts them
                write_atomically(marker, json.dumps({"rows": start + len(part)}).encode())
                progress(start + len(part))
    finally:
        encoder.train(training)
    draft.replace(path)
    marker.unlink(missing_ok=True)


def _rows_done(draft: Path, marker: Path, shape: tuple[int, int]) -> int:
    """Rows that an interrupted computation has left; 0 if there are none."""
    try:
        rows = int(json.loads(marker.read_text())["rows"])
        return rows if np.load(draft, mmap_mode="r").shape == shape else 0
    except (OSError, ValueError, KeyError, EOFError):
        return 0
