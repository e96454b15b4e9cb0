"""The environments that `gymnasium.make` knows once dohyo is imported, without importing gymnasium itself: 0.2 s."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType

SINGLE = "dohyo.evaluation.benchmarks.environments:make_env"
REMOTE = "dohyo.service.client.remote_env:RemoteEnv"
VECTOR = "dohyo.evaluation.benchmarks.environments:make_vec"

BENCHMARKS = {"Quickstart": "quickstart", "NoCrash": "nocrash", "Leaderboard": "leaderboard-train"}
"""Benchmark by the name of its environment; `dohyo/Driving-v0` takes scenarios or a network with missions."""

_REGISTRATION = "gymnasium.envs.registration"


def register_all() -> None:
    """Adds `dohyo/Driving-v0`, `dohyo/Remote-v0` and an id per benchmark to gymnasium's registry; others stay."""
    from gymnasium.envs.registration import register, registry

    for name, benchmark in {"Driving": None, **BENCHMARKS}.items():
        if f"dohyo/{name}-v0" not in registry:
            kwargs = {"source": benchmark} if benchmark else {}
            register(f"dohyo/{name}-v0", entry_point=SINGLE, vector_entry_point=VECTOR, kwargs=kwargs)
    if "dohyo/Remote-v0" not in registry:
        register("dohyo/Remote-v0", vector_entry_point=REMOTE)


def register_once_imported() -> None:
    """Calls `register_all` now if gymnasium is imported, else as soon as it is."""
    if _REGISTRATION in sys.modules:
        register_all()
    elif not any(isinstance(finder, _RegistrationFinder) for finder in sys.meta_path):
        sys.meta_path.insert(0, _RegistrationFinder())


class _RegistrationFinder(MetaPathFinder):
    """Has the import of gymnasium's registration followed by ours."""

    def find_spec(self, name: str, path: Sequence[str] | None, target: ModuleType | None = None) -> ModuleSpec | None:
        """Spec of the module as all other finders find it, with a loader that registers afterwards."""
        if name != _REGISTRATION:
            return None
        others = (finder.find_spec(name, path, target) for finder in sys.meta_path if finder is not self)
        spec = next((spec for spec in others if spec is not None), None)
        if spec is not None and spec.loader is not None:
            spec.loader = _RegisteringLoader(spec.loader)
        return spec


class _RegisteringLoader(Loader):
    """Loads a module by its own loader, then registers our environments."""

    def __init__(self, loader: Loader) -> None:
        self._loader = loader

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        """See `importlib.abc.Loader`."""
        return self._loader.create_module(spec)

    def exec_module(self, module: ModuleType) -> None:
        """See `importlib.abc.Loader`."""
        sys.meta_path[:] = [finder for finder in sys.meta_path if not isinstance(finder, _RegistrationFinder)]
        module.__loader__ = self._loader
        if module.__spec__ is not None:
            module.__spec__.loader = self._loader
        self._loader.exec_module(module)
        register_all()
