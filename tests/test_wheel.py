"""The wheel: one name, all its data, and a stranger's folder where it is used beside modules of their own."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import httpx
import pytest

from tests.agents.forecasting.roads import road_speeds, write_csv

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]
FLOORS = ("sumo_networks", "evaluation", "agents", "service")
PROJECT = ("dohyo", *FLOORS, "pyproject.toml", "README.md", "LICENSE")
NOT_IN_THE_WHEEL = re.compile(r"\.md$|/results/|__pycache__|/\.lock$")
"""Documents, results, and what runs leave in a working copy."""
LOCK = "agents/league/editions/2027-01/.lock"
"""Left where rows of the league are driven."""
BUILD = "import setuptools.build_meta as backend, sys; backend.build_wheel(sys.argv[1])"

BENCHMARK = """
name = "short"
description = "for tests"
headline = "driving_score"
metric = "driving score"
network = "ingolstadt"
traffic = { vehicles = 3, pedestrians = 3, warm_up_s = 2.0 }
seeds = [0]

[[missions]]
name = "along"
start = { lane = "737320747#3_2", position_m = 5.0 }
goal = { lane = "737320747#4_2", position_m = 20.0 }
"""

AGENT = """
import numpy as np
from dohyo.evaluation.agent import Agent, AgentSpec

class Mine(Agent):
    spec = AgentSpec(name="mine", sensors=("speedometer",), control="lane_command")

    def act(self, observation):
        return np.array([6.0, 0.0])
"""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built from a copy, so that nothing of an earlier build gets in."""
    copy, out = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("wheel")
    for name in PROJECT:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, copy / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(ROOT / name, copy / name)
    (copy / LOCK).touch()
    subprocess.run([sys.executable, "-c", BUILD, str(out)], cwd=copy, check=True, capture_output=True, timeout=300)
    (built,) = out.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def dohyo(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The command, installed in an environment of its own that borrows the libraries of this one."""
    home = tmp_path_factory.mktemp("home") / "venv"
    venv.create(home, with_pip=False)
    python = home / "bin" / "python"
    install = [sys.executable, "-m", "pip", "--python", str(python), "install", "-q", "--no-deps", str(wheel)]
    subprocess.run(install, check=True, capture_output=True, timeout=300)
    (packages,) = home.glob("lib/python*/site-packages")
    lend_kernels(packages / "dohyo")
    (packages / "borrowed.pth").write_text("\n".join(one for one in sys.path if one.endswith("site-packages")) + "\n")
    return str(home / "bin" / "dohyo")


def lend_kernels(installed: Path) -> None:
    """Lets what is installed find the kernels that were compiled for these files, which takes half a minute.

    Numba takes a kernel for that of a file by the file's content, in older versions by its time and size.
    """
    for floor in FLOORS:
        for file in (ROOT / floor).rglob("*.py"):
            copy = installed / file.relative_to(ROOT)
            if copy.exists() and copy.read_bytes() == file.read_bytes():
                os.utime(copy, ns=(file.stat().st_atime_ns, file.stat().st_mtime_ns))
        for kernel in (ROOT / floor).rglob("__pycache__/*.nb[ci]"):
            copy = installed / kernel.relative_to(ROOT)
            copy.parent.mkdir(exist_ok=True)
            shutil.copy(kernel, copy)


def strangers_folder(path: Path, initialised: bool) -> Path:
    """Folders named as dohyo's floors, with an agent in each."""
    for name in FLOORS:
        (path / name).mkdir()
        (path / name / "mine.py").write_text(AGENT)
        if initialised:
            (path / name / "__init__.py").write_text("")
    (path / "short.toml").write_text(BENCHMARK)
    return path


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return strangers_folder(tmp_path, initialised=False)


def run(command: str, *arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [command, *arguments], cwd=cwd, capture_output=True, text=True, timeout=300, env=environment(cwd), check=False
    )


def environment(folder: Path) -> dict[str, str]:
    return {key: value for key, value in os.environ.items() if key != "PYTHONPATH"} | {
        "DOHYO_HOME": str(folder / "home")
    }


def test_it_holds_one_name_and_every_file_of_the_floors(wheel: Path) -> None:
    names = set(zipfile.ZipFile(wheel).namelist())
    assert {name.partition("/")[0].partition("-")[0] for name in names} == {"dohyo"}
    files = [path.relative_to(ROOT) for floor in FLOORS for path in (ROOT / floor).rglob("*") if path.is_file()]
    expected = {f"dohyo/{path}" for path in files if not NOT_IN_THE_WHEEL.search(str(path))}
    assert expected - names == set()
    assert f"dohyo/{LOCK}" not in names


@pytest.mark.parametrize("initialised", [False, True])
def test_an_agent_of_ones_own_drives_and_is_verified(dohyo: str, initialised: bool, tmp_path: Path) -> None:
    folder = strangers_folder(tmp_path, initialised)
    result = run(dohyo, "evaluate", "--agent", "agents.mine:Mine", "--benchmark", "short.toml", "--json", cwd=folder)
    assert result.returncode == 0, result.stderr
    (drive,) = json.loads(result.stdout)["drives"]
    assert not drive["failure"], drive
    assert run(dohyo, "verify", drive["record"], "--trust", cwd=folder).returncode == 0


def test_a_module_that_cannot_be_imported_is_named_with_the_cause(dohyo: str, folder: Path) -> None:
    (folder / "agents" / "broken.py").write_text("import no_such_library\n")
    result = run(dohyo, "evaluate", "--agent", "agents.broken:X", "--benchmark", "short.toml", cwd=folder)
    assert result.returncode == 2
    (line,) = result.stderr.splitlines()
    assert "module 'agents.broken' cannot be imported: ModuleNotFoundError" in line
    assert "no_such_library" in line


def test_stored_rows_that_the_wheel_lacks_are_told_of(dohyo: str, folder: Path) -> None:
    page = run(dohyo, "league", "table", cwd=folder)
    assert page.returncode == 0, page.stderr
    assert "in dohyo's repository only" in page.stdout
    studies = run(str(Path(dohyo).with_name("python")), "-m", "dohyo.agents.studies", "ghrl", "table", cwd=folder)
    assert studies.returncode == 1
    assert "they are in dohyo's repository only" in studies.stderr


def test_forecasts_are_measured(dohyo: str, folder: Path) -> None:
    write_csv(folder / "speeds.csv", road_speeds(200, 3))
    result = run(dohyo, "forecast", "fit", "--data", "speeds.csv", "--model", "persistence", "--json", cwd=folder)
    assert json.loads(result.stdout)["segments"] == 3


def test_the_service_starts_answers_and_stops(dohyo: str, folder: Path) -> None:
    command = [dohyo, "serve", "--port", "0", "--data", "data"]
    with subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, text=True, env=environment(folder)) as service:
        assert service.stdout is not None
        url = service.stdout.readline().strip().removeprefix("dohyo: ")
        transport = httpx.HTTPTransport(retries=8)  # a minute: each wait is twice the last one
        with httpx.Client(transport=transport, timeout=120) as client:
            assert client.get(f"{url}/health/live").status_code == 200
            assert client.get(f"{url}/v1/benchmarks").status_code in (200, 401)
        service.send_signal(signal.SIGTERM)
        service.stdout.read()
    assert service.returncode == 0
