"""Kernels of the search: compiled without counts of references.

numba counts, atomically, who refers to each array that a function is handed. Situation, tree and beliefs have 44 of
them, and counting took more than half of a search. These kernels allocate no array and keep none, so that there is
nothing to count; numba compiles none that allocates.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, TypeVar

from numba import njit

F = TypeVar("F", bound=Callable[..., Any])

_OPTIONS: Final[dict[str, Any]] = {"error_model": "numpy", "_nrt": False}
"""The second, without numba's runtime for references, is an option that numba does not document."""


def kernel(function: F) -> F:
    """Compiles a function, once per installation."""
    compiled: F = njit(**_OPTIONS, cache=True)(function)
    return compiled


def inlined(function: F) -> F:
    """The same, and copies it into the kernels that call it."""
    compiled: F = njit(**_OPTIONS, cache=True, inline="always")(function)
    return compiled


def uncounted(function: F) -> F:
    """The kernel of another package, compiled in the same way as part of those that call it."""
    compiled: F = njit(**_OPTIONS)(function.py_func)  # type: ignore[attr-defined]
    return compiled
