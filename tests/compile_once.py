"""Processes that test beside each other compile each kernel once: the others wait, and load it from numba's cache.

In a fresh clone nothing is compiled, and six processes that begin together need the same kernels.
"""

from __future__ import annotations

import fcntl
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path
from typing import Any

from numba.core.compiler_lock import global_compiler_lock
from numba.core.dispatcher import Dispatcher

FOLDER = Path(tempfile.gettempdir()) / f"dohyo-kernels-{os.getuid()}"
_compile = Dispatcher.compile
_held: set[Path] = set()
"""Locks of this process. Only who has the compiler's lock changes it, which also keeps threads apart."""


def install() -> None:
    """Makes this process one of those that compile each kernel once."""
    FOLDER.mkdir(exist_ok=True)
    Dispatcher.compile = _compile_once


def _compile_once(self: Any, signature: Any) -> Any:
    place = self._cache.cache_path
    if place is None:  # its machine code is not kept
        return _compile(self, signature)
    name = f"{place} {self.py_func.__module__}.{self.py_func.__qualname__}"
    with global_compiler_lock, _locked(FOLDER / sha256(name.encode()).hexdigest()):
        return _compile(self, signature)


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Keeps other processes out. Kernels call each other without circles, so that no process waits for itself."""
    if path in _held:  # one kernel for two signatures
        yield
        return
    with path.open("w") as file:
        fcntl.lockf(file, fcntl.LOCK_EX)  # ends with the process, and is not handed on to those that it forks
        _held.add(path)
        try:
            yield
        finally:
            _held.discard(path)
