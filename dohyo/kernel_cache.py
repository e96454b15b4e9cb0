"""Numba's cache: a kernel is compiled again once anything changes that it was compiled from.

Numba compares a kernel's own file alone. Its machine code also holds the functions that it calls in other files, and
the constants that these read. Here they enter the comparison, for kernels of dohyo and of modules that import from it.
"""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum, EnumMeta
from functools import cache, cached_property
from hashlib import sha256
from types import CodeType, EllipsisType, FunctionType, ModuleType, NoneType
from typing import Any

import numpy as np

_PLAIN = (int, float, complex, str, bytes, NoneType, EllipsisType, np.generic, np.dtype)
"""Constants that `repr` writes in full."""


def install() -> None:
    """Makes numba ask `KernelLocator` first, which leaves the kernels of other packages to numba's own locators."""
    from numba.core.caching import CacheImpl

    if KernelLocator not in CacheImpl._locator_classes:
        CacheImpl._locator_classes.insert(0, KernelLocator)


class KernelLocator:
    """Locator as numba's cache expects it: numba's own one, with another stamp."""

    def __init__(self, own: Any, function: FunctionType) -> None:
        self._own = own
        self._function = function

    @classmethod
    def from_function(cls, function: FunctionType, file: str) -> KernelLocator | None:
        """Locator of a kernel that may depend on dohyo's files, else None."""
        from numba.core.caching import CacheImpl

        if not any(_package(value) == "dohyo" for value in (function, *function.__globals__.values())):
            return None
        others: list[Any] = [kind for kind in CacheImpl._locator_classes if kind is not cls]
        found = (kind.from_function(function, file) for kind in others)
        own = next((locator for locator in found if locator is not None), None)
        return cls(own, function) if own is not None else None

    def get_source_stamp(self) -> Stamp:
        """Stamp that numba stores with the machine code, and compares before it loads that."""
        return Stamp(self._own.get_source_stamp(), self._function)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._own, name)


class Stamp:
    """Stamp of a kernel, computed at its first call: when it is declared, what it calls may not be defined yet."""

    def __init__(self, own: Any, function: FunctionType) -> None:
        self._own = own
        self._function = function

    @cached_property
    def value(self) -> tuple[Any, str]:
        """Numba's own stamp, and the digest of all that the kernel refers to."""
        return self._own, digest(self._function)

    def __eq__(self, other: object) -> bool:
        return self.value == other

    def __hash__(self) -> int:
        return hash(self.value)

    def __reduce__(self) -> tuple[type, tuple[tuple[Any, str]]]:
        """Stored as a plain tuple, which is read back without this module."""
        return tuple, (self.value,)


def digest(function: FunctionType) -> str:
    """Hash of a function, of all functions that it calls, directly or indirectly, and of the constants they read.

    They are taken from memory, as numba compiles them, since a file may have changed after its import. The hash does
    not depend on where the files lie.
    """
    found, waiting = {function}, [function]
    while waiting:
        called = _description(waiting.pop())[1] - found
        found |= called
        waiting += called
    return sha256("\n".join(sorted(_description(one)[0] for one in found)).encode()).hexdigest()


@cache
def _description(function: FunctionType) -> tuple[str, frozenset[FunctionType]]:
    """Code, defaults, options and constants of a function as text; and the functions that it refers to."""
    lines, called = set(), set()
    for name, value in _globals(function):
        target = getattr(value, "__wrapped__", value)  # the function of a kernel
        if isinstance(target, FunctionType):
            options = sorted(getattr(value, "targetoptions", {}).items())
            lines.add(f"{name} {_name(target)} {_constant(options)}")
            if _package(target) in ("dohyo", _package(function)):
                called.add(target)
        else:
            lines.add(f"{name} {_constant(value)}")
    own = f"{_name(function)} {_code(function.__code__)} {_constant(function.__defaults__)}"
    return "\n".join([own, *sorted(lines)]), frozenset(called)


def _globals(function: FunctionType) -> Iterator[tuple[str, Any]]:
    """Names in a function's code with their values in its closure, its module, and modules of dohyo or its package."""
    code = function.__code__
    names = _names(code) | {function.__name__}  # its own, too, for the options that its decorator gave
    yield from zip(code.co_freevars, (cell.cell_contents for cell in function.__closure__ or ()), strict=True)
    places: list[dict[str, Any]] = [function.__globals__]
    for place in places:
        for name in names & place.keys():
            value = place[name]
            if not isinstance(value, ModuleType):
                yield name, value
            elif _package(value) in ("dohyo", _package(function)) and not any(vars(value) is one for one in places):
                places.append(vars(value))


def _names(code: CodeType) -> set[str]:
    """Names of globals and attributes in code, also in functions within it."""
    inner = [_names(constant) for constant in code.co_consts if isinstance(constant, CodeType)]
    return set(code.co_names).union(*inner)


def _code(code: CodeType) -> str:
    constants = [_code(one) if isinstance(one, CodeType) else _constant(one) for one in code.co_consts]
    return repr((code.co_code, code.co_names, code.co_varnames, code.co_argcount, code.co_flags, constants))


def _constant(value: Any) -> str:
    """A constant as text, the same in every process; of anything else only its name or its type's."""
    if isinstance(value, Enum):
        return f"{_name(type(value))}.{value.name} {_constant(value.value)}"
    if isinstance(value, _PLAIN):
        return repr(value)
    if isinstance(value, np.ndarray):
        return f"{value.dtype} {value.shape} {value.strides} {sha256(value.tobytes()).hexdigest()}"
    if isinstance(value, tuple | list):
        return f"{type(value).__name__}({', '.join(map(_constant, value))})"
    if isinstance(value, frozenset):
        return f"frozenset({', '.join(sorted(map(_constant, value)))})"
    if isinstance(value, type):
        members = list(value) if isinstance(value, EnumMeta) else getattr(value, "_fields", ())
        return f"{_name(value)}({', '.join(map(_constant, members))})"
    return _name(value if hasattr(value, "__qualname__") else type(value))


def _name(value: Any) -> str:
    return f"{value.__module__}.{value.__qualname__}"


def _package(value: Any) -> str:
    """First part of the name of the module that something is, or comes from; empty if it has none."""
    module = value.__name__ if isinstance(value, ModuleType) else getattr(value, "__module__", None)
    return module.partition(".")[0] if isinstance(module, str) else ""
