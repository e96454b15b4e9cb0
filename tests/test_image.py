"""The image: what the Dockerfile, compose.yaml and their scripts say of each other. `.ci/image` builds and tries it."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import urllib.request
from pathlib import Path

import pytest
import yaml

from dohyo.sumo_networks.networks.entries import builtin_names, network_entry

ROOT = Path(__file__).parents[1]
SCRIPT = ROOT / ".ci/image"
CANNOT = 77


def instructions() -> list[tuple[str, str]]:
    """Names and arguments of the Dockerfile's final stage."""
    lines = re.sub(r"\\\n\s*", "", (ROOT / "Dockerfile").read_text()).splitlines()
    parsed = [(name, rest) for name, _, rest in (line.partition(" ") for line in lines) if name.isupper()]
    first = max(number for number, (name, _) in enumerate(parsed) if name == "FROM")
    return parsed[first:]


def argument(wanted: str) -> str:
    """What an instruction says that the final stage has once."""
    (found,) = [rest for name, rest in instructions() if name == wanted]
    return found


def test_the_image_has_the_libraries_that_setup_names_and_no_compiler() -> None:
    named = re.search(r"^SYSTEM_PACKAGES := (.+)$", (ROOT / "Makefile").read_text(), re.MULTILINE)
    installed = re.search(r"--no-install-recommends ([^&]+)&&", argument_with("apt-get install"))
    assert named
    assert installed
    assert installed[1].split() == named[1].split()


def argument_with(part: str) -> str:
    (found,) = [rest for name, rest in instructions() if name == "RUN" and part in rest]
    return found


def test_the_service_is_the_default_with_its_volume_and_not_root() -> None:
    assert json.loads(argument("CMD")) == ["dohyo", "serve"]
    assert not re.match(r"0|root", argument("USER"))
    assert f"DOHYO_DATA={argument('VOLUME')}" in argument("ENV")
    assert f"DOHYO_PORT={argument('EXPOSE')}" in argument("ENV")
    assert f"-o dohyo -g dohyo {argument('VOLUME')}" in argument_with("install -d")


@pytest.mark.parametrize(
    ("host", "asked"),
    [("0.0.0.0", "127.0.0.1"), ("127.0.0.1", "127.0.0.1"), ("::", "[::1]"), ("::1", "[::1]"), ("10.0.0.7", "10.0.0.7")],
)
def test_the_health_check_asks_where_the_service_listens(
    monkeypatch: pytest.MonkeyPatch, host: str, asked: str
) -> None:
    """`::` hears IPv6 alone. Before, such a service was unhealthy for ever."""
    urls: list[str] = []
    monkeypatch.setattr(urllib.request, "urlopen", lambda url, timeout: urls.append(url))
    monkeypatch.setenv("DOHYO_HOST", host)
    monkeypatch.setenv("DOHYO_PORT", "8123")
    python, option, program = json.loads(argument("HEALTHCHECK").partition(" CMD ")[2])
    assert (python, option) == ("python", "-c")
    exec(program, {})
    assert urls == [f"http://{asked}:8123/health/ready"]


def test_compose_keeps_the_data_and_runs_the_demo_of_make() -> None:
    services = yaml.safe_load((ROOT / "compose.yaml").read_text())["services"]
    assert "command" not in services["serve"]
    assert services["serve"]["volumes"] == [f"data:{argument('VOLUME')}"]
    assert services["demo"]["volumes"] == [f"./out:{argument('WORKDIR')}/out"]
    steps = [line.replace(".html", "") for line in services["demo"]["command"][-1].splitlines()]
    make = re.search(r"^demo:.*\n((?:\t.+\n)+)", (ROOT / "Makefile").read_text(), re.MULTILINE)
    assert make
    expected = (
        make[1].replace("\t@$(BIN)/", "").replace("$(RESULTS)", "out/quickstart").replace("$(REPORT)", "out/report")
    )
    assert steps == expected.splitlines()


def test_no_secret_is_built_into_the_image_or_committed() -> None:
    """What hosting.md has people make beside compose.yaml: settings, data, keys."""
    left_out = set((ROOT / ".dockerignore").read_text().split())
    assert left_out >= {"**/.env*", "service.env", "certificates", "dohyo-data", "**/*.pem", ".git"}
    assert set((ROOT / ".gitignore").read_text().split()) >= {".env*", "/service.env", "/certificates/", "dohyo-data/"}
    document = yaml.safe_load((ROOT / "compose.yaml").read_text())
    assert document["services"]["serve"]["env_file"] == [{"path": "service.env", "required": False}]
    kept = [one.partition(":")[0] for name in ("serve", "proxy") for one in document["services"][name]["volumes"]]
    assert set(kept) == set(document["volumes"]), "Caddy's keys and the data lie in volumes, not in this folder"


def test_what_dohyo_takes_from_sumo_stays_in_the_image() -> None:
    slim = (ROOT / ".ci/slim").read_text()
    kept = set(re.findall(r"! -name (\S+)", slim))
    sources = "".join(path.read_text() for path in (ROOT / "sumo_networks").rglob("*.py"))
    assert set(re.findall(r'run_program\("(\w+)"', sources)) <= kept
    files = [network_entry(name).sumo_file for name in builtin_names()]
    folders = {Path(file).parts[:2] for file in files if file}
    assert folders == {("tools", "game")}
    assert "game" in kept


@pytest.fixture
def few_commands(tmp_path: Path) -> dict[str, str]:
    """An environment without buildah and without a way to get it."""
    for name in ("bash", "dirname", "sed", "id"):
        found = shutil.which(name)
        assert found
        (tmp_path / name).symlink_to(found)
    return {"PATH": str(tmp_path)}


def test_without_buildah_the_script_says_so_with_a_code_of_its_own(few_commands: dict[str, str]) -> None:
    done = subprocess.run([SCRIPT], env=few_commands, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == CANNOT
    assert "buildah" in done.stderr


@pytest.mark.parametrize("wrong", [["--bas", "x"], ["--base"], ["--wheels", "no/such/folder"]])
def test_wrong_options_are_refused(wrong: list[str], few_commands: dict[str, str]) -> None:
    done = subprocess.run([SCRIPT, *wrong], env=few_commands, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert wrong[-1] in done.stderr or wrong[0] in done.stderr
