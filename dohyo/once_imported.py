"""Calls a function once another module has been imported, so that dohyo need not import that module itself."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType


def once_imported(module: str, call: Callable[[], None]) -> None:
    """Calls a function now if a module is imported, else as soon as it is.

    Args:
        module: Full name of the module.
        call: Function without arguments.
    """
    if module in sys.modules:
        call()
    elif not any(isinstance(finder, _Finder) and finder.module == module for finder in sys.meta_path):
        sys.meta_path.insert(0, _Finder(module, call))


class _Finder(MetaPathFinder):
    """Has the import of a module followed by a call."""

    def __init__(self, module: str, call: Callable[[], None]) -> None:
        self.module = module
        self.call = call

    def find_spec(self, name: str, path: Sequence[str] | None, target: ModuleType | None = None) -> ModuleSpec | None:
        """Spec of the module as all other finders find it, with a loader that calls the function afterwards."""
        if name != self.module:
            return None
        others = (finder.find_spec(name, path, target) for finder in sys.meta_path if finder is not self)
        spec = next((spec for spec in others if spec is not None), None)
        if spec is not None and spec.loader is not None:
            spec.loader = _Loader(spec.loader, self)
        return spec


class _Loader(Loader):
    """Loads a module by its own loader, then calls the function."""

    def __init__(self, loader: Loader, finder: _Finder) -> None:
        self._loader = loader
        self._finder = finder

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        """See `importlib.abc.Loader`."""
        return self._loader.create_module(spec)

    def exec_module(self, module: ModuleType) -> None:
        """See `importlib.abc.Loader`."""
        sys.meta_path[:] = [finder for finder in sys.meta_path if finder is not self._finder]
        module.__loader__ = self._loader
        if module.__spec__ is not None:
            module.__spec__.loader = self._loader
        self._loader.exec_module(module)
        self._finder.call()
