"""What the documents say exists: commands, options, targets, links, names, numbers; and the example agent drives."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import tomllib
from importlib import import_module
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer

from dohyo.agents.forecasting.registry import shipped
from dohyo.agents.registry import TRAINABLE, agent_entries, resolve, resolve_with, wrapped_entries
from dohyo.agents.speed_planning.benchmark import NOBODY, PLANNER
from dohyo.evaluation.agent import make_agent
from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.evaluation.benchmarks.documents import benchmark_names, find_family
from dohyo.evaluation.entry import load_entry
from dohyo.evaluation.families import Family
from dohyo.evaluation.records.store import seal, write_record
from dohyo.evaluation.running.manifest import MANIFEST, RECORDS
from dohyo.evaluation.settings import check_settings
from dohyo.service.cli import app
from dohyo.service.cli.commands.evaluate import parse_settings
from dohyo.service.cli.lazy import LazyCommand
from dohyo.service.policies.agent import NAME as ONNX
from dohyo.service.settings import Settings
from dohyo.sumo_networks.ego.control import CONTROLS
from dohyo.sumo_networks.envs.driving_env import DrivingEnv
from dohyo.sumo_networks.networks.entries import builtin_names
from dohyo.sumo_networks.sensors import SENSORS
from tests.evaluation.builders import drive, episode
from tests.test_context import table, text

ROOT = Path(__file__).parents[1]
FLOORS = ("service", "agents", "evaluation", "sumo_networks")
DOCUMENTS = [
    *(ROOT / name for name in ("README.md", "CONTEXT.md", "CONTRIBUTING.md", "CHANGELOG.md")),
    *sorted(path for top in (*FLOORS, "docs") for path in (ROOT / top).rglob("*.md")),
]
API = ROOT / "docs/reference/api"
EXAMPLE = "examples.lane_keeper:LaneKeeper"
FENCE = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)

document = pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))


def fences(source: str, language: str = "") -> list[str]:
    return [body for found, body in FENCE.findall(source) if found == language]


def inline(source: str) -> list[str]:
    return re.findall(r"`([^`\n]+)`", FENCE.sub("", source))


def shell_lines(source: str) -> list[str]:
    """Lines of commands, in code blocks and in running text."""
    blocks = [block.replace("\\\n", " ") for block in (*fences(source), *fences(source, "sh"))]
    return [line.split("#")[0].strip() for block in blocks for line in block.splitlines()] + inline(source)


def dohyo_commands(source: str) -> list[list[str]]:
    return [shlex.split(line)[1:] for line in shell_lines(source) if line.split()[:1] == ["dohyo"]]


def make_targets(source: str) -> set[str]:
    """Targets of every "make ..." among the commands, variables left out."""
    found = re.findall(r"(?:^|[`&;\s])make((?: [\w=./*]+)+)", "\n".join(shell_lines(source)))
    return {word for words in found for word in words.split() if "=" not in word}


def defined_targets() -> set[str]:
    return set(re.findall(r"^([a-z]+):", text("Makefile"), re.MULTILINE))


def command_of(words: list[str]) -> tuple[Any, list[str]]:
    """The command that words name, and the words left."""
    command: Any = typer.main.get_command(app)
    while hasattr(command, "commands") and words and not words[0].startswith("-"):
        assert words[0] in command.commands, f"there is no 'dohyo ... {words[0]}'"
        command, words = command.commands[words[0]], words[1:]
    return command, words


def options_of(command: Any) -> set[str]:
    command = command.load() if isinstance(command, LazyCommand) else command
    own = {name for parameter in command.params for name in parameter.opts + parameter.secondary_opts}
    below = getattr(command, "commands", {}).values()
    return own.union(*map(options_of, below))


@document
def test_every_dohyo_command_and_option_exists(path: Path) -> None:
    for words in dohyo_commands(path.read_text()):
        command, rest = command_of(words)
        for word in rest:
            assert not word.startswith("--") or word in options_of(command), f"{words}: no option {word}"


@document
def test_every_agent_and_benchmark_of_a_command_exists(path: Path) -> None:
    for words in dohyo_commands(path.read_text()):
        named = dict(pairwise(words))
        agent, benchmark = named.get("--agent", "NAME"), named.get("--benchmark", "NAME")
        if words[:1] == ["worker"]:
            agent = named.get("--entry", "module:Class")  # --agent is its name at a service
        family = Family.DRIVING if benchmark in ("NAME", "mine.toml") else find_family(benchmark)
        if family is Family.PARKING:
            if agent != "NAME":
                module, _, name = agent_entries().get(agent, agent).partition(":")
                assert hasattr(import_module(module), name), agent
            continue
        if family in (Family.FREEWAY, Family.FORECASTING):
            assert agent in ("NAME", "persistence", *shipped(), PLANNER, NOBODY)
            continue
        agents = {agent, *(after for word, after in pairwise(words) if word == "--agent" and "=" in after)}
        for one in {name.partition("=")[2] or name for name in agents}:
            if one not in ("NAME", "AGENT", ONNX, "module:Class", "my_module:MyAgent", "my_module:MyForecaster"):
                if one in TRAINABLE:  # they need a policy
                    load_entry(resolve(one), "agent")
                else:
                    make_agent(agent_entries().get(one, one))


@document
def test_every_setting_of_an_agent_in_a_command_is_one_that_it_takes(path: Path) -> None:
    for words in dohyo_commands(path.read_text()):
        agent = dict(pairwise(words)).get("--agent")
        pairs = [value for option, value in pairwise(words) if option == "--set"]
        if words[:1] != ["evaluate"] or not pairs or agent not in agent_entries():
            continue
        entry, given = resolve_with(agent, parse_settings(pairs))
        if wrapped_entries(entry, given)[0] == [entry]:
            check_settings(load_entry(entry, "agent"), agent, given)


@document
def test_every_module_of_a_command_exists(path: Path) -> None:
    if path.name == "CHANGELOG.md":  # it also names what is gone
        return
    for words in map(str.split, shell_lines(path.read_text())):
        if words[:2] == ["python", "-m"] and words[2].startswith(("dohyo.", "tests.")):
            assert find_spec(words[2]) is not None, words


def test_every_option_in_the_readme_exists() -> None:
    known = options_of(typer.main.get_command(app)) | {"--rm"}
    assert {word for line in shell_lines(text("README.md")) for word in re.findall(r"--[\w-]+", line)} <= known


@document
def test_every_make_target_exists(path: Path) -> None:
    assert make_targets(path.read_text()) <= defined_targets()


def test_the_readmes_two_commands_are_targets() -> None:
    assert {"make demo\n", "make test\n"} <= set(fences(text("README.md")))
    assert {"setup", "demo", "test", "lint", "bench", "docs"} <= defined_targets()


def test_make_knows_its_targets() -> None:
    if shutil.which("make") is None:
        pytest.skip("no make on this machine")
    for target in sorted(defined_targets()):
        subprocess.run(["make", "--dry-run", target], cwd=ROOT, check=True, capture_output=True)


@document
def test_every_relative_link_resolves(path: Path) -> None:
    for target in re.findall(r"\]\(([^)\s]+)\)", FENCE.sub("", path.read_text())):
        if not target.startswith(("http://", "https://", "#")):
            assert (path.parent / target.split("#")[0]).exists(), target


@document
def test_every_path_named_exists(path: Path) -> None:
    source = path.read_text()
    to_be_made = set(re.findall(r"New file `([^`]+)`:", source))
    for name in set(inline(source)) - to_be_made:
        if re.search(r"[A-Z]{4}|^out/|^build/|^\.venv/|^application/", name):
            continue  # a placeholder, made by a command, or a media type
        if re.fullmatch(r"[\w.]+(/[\w.]+)+/?", name):
            assert (ROOT / name).exists() or (path.parent / name).exists(), name
        elif re.fullmatch(r"\w+\.(py|toml|yaml)", name):
            assert any(list(ROOT.glob(pattern + name)) for pattern in ("", *(f"{top}/**/" for top in FLOORS))), name


@document
def test_every_file_of_a_result_folder_is_one_that_driving_writes(path: Path) -> None:
    for name, file in re.findall(r"\bout/([\w-]+)/[\w.-]+/([\w./-]+)", path.read_text()):
        if name in benchmark_names(Family.DRIVING):
            benchmark = load_benchmark(name)
            stems = {f"{one.name}-s{one.seed}" for one in benchmark.scenarios(benchmark.seeds)}
            assert file in {MANIFEST, RECORDS, *(f"{RECORDS}/{stem}.json" for stem in stems)}


def test_the_page_of_evaluations_says_what_driving_writes() -> None:
    does, *_ = table(text("docs/researchers/evaluating.md"), "command")["dohyo evaluate --agent NAME --benchmark NAME"]
    assert set(inline(does)) == {f"{RECORDS}/", MANIFEST}


def test_the_block_that_reads_records_reads_those_of_a_result_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "out/quickstart/autopilot"
    write_record(folder / RECORDS, "west-s0", seal(episode(name="west")), drive())
    (folder / MANIFEST).write_text("{}")
    (block,) = fences(text("docs/researchers/evaluating.md"), "python")
    monkeypatch.chdir(tmp_path)
    exec(block, {})
    assert capsys.readouterr().out == "west failed: agent ran out of time []\n"


def test_the_readmes_environment_steps() -> None:
    (block,) = fences(text("README.md"), "python")
    names: dict[str, Any] = {}
    exec(block, names)
    try:
        assert set(names["observation"]) == set(names["env"].observation_space)
        assert (names["terminated"], names["truncated"]) == (False, False)
    finally:
        names["env"].close()


def test_the_example_drives() -> None:
    agent = make_agent(EXAMPLE)
    scenario = load_benchmark("quickstart").scenarios([0])[0]
    env = DrivingEnv(scenario, agent.spec.sensors, agent.spec.control, reward=None)
    try:
        observations, _ = env.reset()
        agent.reset(scenario.missions[0], scenario.seed)
        for _ in range(50):
            action = agent.act(observations["ego"])
            env.check_action("ego", action)
            observations = env.step({"ego": action})[0]
        assert env.world.egos.driven[0] > 10.0
        assert abs(env.world.egos.lateral[0]) < 0.5
    finally:
        env.close()


def test_the_example_stops_for_red_and_for_people() -> None:
    route = np.zeros((80, 7), np.float32)
    route[:, 0], route[:, 4] = np.arange(80), 13.9
    nobody, no_light = np.full((48, 8), -1.0, np.float32), np.array([[1000, 1000, -1, 0]] * 4, np.float32)
    somebody, red = nobody.copy(), no_light.copy()
    somebody[0, :3] = 6, 5.0, 0.5  # a pedestrian, 5 m ahead of the centre
    red[0] = 1.0, 20.0, 1, 0  # a red light, a metre ahead of the front
    agent = make_agent(EXAMPLE)
    free, person, light = (
        agent.act({"route": route, "objects": objects, "junctions_ahead": junctions})[0]
        for objects, junctions in ((nobody, no_light), (somebody, no_light), (nobody, red))
    )
    assert free == pytest.approx(13.9, abs=0.01)
    assert person == 0.0
    assert light == 0.0


def test_the_tables_of_sensors_and_controls() -> None:
    source = text("docs/researchers/sensors.md")
    sensors = table(source, "sensor")
    assert set(sensors) <= set(SENSORS)
    for name, (shape, track, _) in sensors.items():
        sensor = SENSORS[name]  # space and track belong to the class
        assert (str(sensor.space.shape), sensor.track.name.lower()) == (shape, track), name
    assert set(table(source, "control")) == set(CONTROLS)


def test_the_page_of_benchmarks_has_all() -> None:
    found = set(table(text("docs/reference/benchmarks.md"), "benchmark"))
    assert found == {"localization", *(name for family in Family for name in benchmark_names(family))}


def test_the_page_of_networks_has_all() -> None:
    assert set(table(text("docs/engineers/networks.md"), "network")) == set(builtin_names())


def test_the_page_of_hosting_has_every_setting() -> None:
    assert set(table(text("docs/organisers/hosting.md"), "setting")) == set(Settings.model_fields)


def test_every_attack_of_the_threat_model_is_a_test() -> None:
    named = re.findall(r"`([\w/]+\.py)::(test_\w+)`", text("docs/organisers/security.md"))
    assert len(named) > 40
    for path, name in named:
        whole = ROOT / path if path.startswith("tests/") else ROOT / "tests/service" / path
        assert re.search(rf"^(async )?def {name}\(", whole.read_text(), re.MULTILINE), f"{path}::{name}"


def test_every_module_of_the_api_reference_exists() -> None:
    named = [name for path in API.glob("*.md") for name in re.findall(r"automodule:: (\S+)", path.read_text())]
    assert len(named) == len(set(named))
    for name in named:
        module = ROOT / name.removeprefix("dohyo.").replace(".", "/")
        assert module.with_suffix(".py").exists() or (module / "__init__.py").exists(), name


@pytest.mark.parametrize("floor", FLOORS)
def test_a_floors_readme_names_every_room(floor: str) -> None:
    rooms = {path.parent.name + "/" for path in (ROOT / floor).glob("*/__init__.py")}
    named = set(table(text(f"{floor}/README.md"), "room"))
    assert rooms <= named
    assert all((ROOT / floor / room).is_dir() for room in named)


def test_the_experts_readme_has_their_specs() -> None:
    source = text("agents/experts/README.md")
    header = next(line for line in source.splitlines() if line.startswith("| |"))
    names = [cell.strip() for cell in header.strip("|").split("|")][1:]
    assert set(names) == {name for name, entry in agent_entries().items() if entry.startswith("dohyo.agents.experts.")}
    rows = {line.split("|")[1].strip(): line.strip("|").split("|")[1:] for line in source.splitlines() if "|" in line}
    for column, name in enumerate(names):
        spec = make_agent(agent_entries()[name]).spec
        assert rows["track"][column].strip() == spec.track
        assert set(re.findall(r"`(\w+)`", rows["sensors"][column])) == set(spec.sensors)
        assert rows["control"][column].strip(" `") == spec.control


def test_ci_runs_lint_site_and_tests_without_a_terminal() -> None:
    ci = ROOT / ".ci/run"
    assert ci.stat().st_mode & 0o111
    assert "set -euo pipefail" in ci.read_text()
    assert "make --output-sync=target lint docs &\nchecks=$!\n" in ci.read_text()
    assert re.search(r"^CI=true .*make test .*&$", ci.read_text(), re.MULTILINE)
    assert ci.read_text().rstrip().endswith('wait "$checks"\nexit "${tested:-0}"')
    subprocess.run(["bash", "-n", str(ci)], check=True)


def test_licence_and_version_agree_everywhere() -> None:
    project = tomllib.loads(text("pyproject.toml"))["project"]
    assert project["license"] == "Apache-2.0"
    assert "Apache License" in text("LICENSE")
    section = "Unreleased" if ".dev" in project["version"] else project["version"]
    assert f"## [{section}]" in text("CHANGELOG.md")
    citation = text("CITATION.cff")
    assert {f"version: {project['version']}", f"license: {project['license']}"} <= set(citation.splitlines())
    assert "torch==2.13.0" in project["dependencies"]
