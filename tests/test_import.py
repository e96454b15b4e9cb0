"""`import dohyo`: quick, with the names that most people start with, and the ids of its gymnasium environments."""

from __future__ import annotations

import json
import subprocess
import sys
from importlib import import_module
from importlib.resources import files

import gymnasium
import pytest

import dohyo


def test_the_import_loads_nothing_heavy() -> None:
    code = "import sys, json, dohyo; json.dump(sorted(sys.modules), sys.stdout)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = set(json.loads(done.stdout))
    assert "dohyo" in loaded
    assert not loaded & {
        "gymnasium",
        "numpy",
        "torch",
        "libsumo",
        "scipy",
        "numba",
        "polars",
        "sqlalchemy",
        "fastapi",
        "plotly",
    }
    assert not [name for name in loaded if name.startswith(("dohyo.sumo_networks", "dohyo.evaluation", "dohyo.agents"))]


def test_the_service_starts_without_torch() -> None:
    code = "import sys, dohyo.service.app; print(*{'torch', 'torchrl', 'onnxruntime'} & sys.modules.keys())"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "\n"


@pytest.mark.parametrize("name", dohyo.__all__)
def test_every_name_is_there_and_typed(name: str) -> None:
    assert getattr(dohyo, name) is getattr(import_module(dohyo._HOMES[name]), name)
    assert name in dir(dohyo)
    assert (files("dohyo") / "py.typed").is_file()


def test_an_unknown_name_is_refused_with_the_known_ones() -> None:
    with pytest.raises(AttributeError, match=r"'Enviroment' \(there is Agent, DrivingEnv"):
        _ = dohyo.Enviroment  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", ["Driving", "Quickstart", "NoCrash", "Leaderboard"])
def test_gymnasium_knows_the_ids(name: str) -> None:
    spec = gymnasium.spec(f"dohyo/{name}-v0")
    assert spec.entry_point is not None
    assert spec.vector_entry_point is not None


@pytest.mark.parametrize(
    "imports",
    [
        "import gymnasium, dohyo",
        "import dohyo, gymnasium",
        "import dohyo; from gymnasium.envs.registration import spec; import gymnasium",
        "import dohyo, importlib.util; importlib.util.find_spec('gymnasium.envs.registration'); import gymnasium",
        "import gymnasium; gymnasium.spec('CartPole-v1'); import importlib; importlib.import_module('dohyo')",
    ],
)
def test_the_ids_are_known_in_whatever_order_both_are_imported(imports: str) -> None:
    code = f"""{imports}
import inspect, sys
import numba  # dohyo waits for its import, too
gymnasium.spec("dohyo/Quickstart-v0")
assert "def register" in inspect.getsource(gymnasium.envs.registration)
assert not any("dohyo" in type(finder).__module__ for finder in sys.meta_path)
"""
    subprocess.run([sys.executable, "-c", code], check=True)


def test_gymnasium_imports_dohyo_by_the_prefix_of_an_id() -> None:
    code = "import gymnasium; env = gymnasium.make('dohyo:dohyo/Quickstart-v0'); print(env.unwrapped.scenarios[0].name)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip()
