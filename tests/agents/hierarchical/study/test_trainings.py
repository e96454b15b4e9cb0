"""Every arm is trained by one command, in processes of its own, which goes on where it was."""

from __future__ import annotations

import json
import signal
import tomllib
from pathlib import Path

import pytest

from dohyo.agents.hierarchical.study import trainings
from dohyo.agents.hierarchical.study.arms import ARMS, MASTER, POLICIES, config_of
from dohyo.agents.learning.files.settings import as_toml, flat
from dohyo.agents.studies.rows import cell_of, read_rows
from dohyo.agents.studies.training_results import find_trainings
from dohyo.sumo_networks.errors import InvalidInputError
from tests.forked import Python

ROOT = Path(__file__).parents[4]
RESULTS = ROOT / "agents" / "hierarchical" / "results" / "training"
TINY = ("steps=24", "held_out=1", "evaluate_every=1000", "ppo.horizon=12", "ppo.batch=12", "ppo.epochs=1")
STUDY = "from dohyo.agents.studies.__main__ import main; main()"
COMMAND = (STUDY, "ghrl-trainings", "run", "--only", "training/right")


@pytest.mark.parametrize("folder", sorted(RESULTS.glob("*/seed-*/*")), ids=lambda path: str(path.relative_to(RESULTS)))
def test_what_results_tell_was_trained_as_the_arm_says(folder):
    arm, seed, policy = folder.relative_to(RESULTS).parts
    told = flat(tomllib.loads(as_toml(config_of(Path("runs"), arm, int(seed.removeprefix("seed-")), policy))))
    stored = flat(tomllib.loads((folder / "config.toml").read_text()))
    stored.pop("options", None)
    assert stored == {name: told[name] for name in stored}  # settings that came later are not in it


def test_a_master_chooses_among_its_arms_sub_policies_or_those_of_another():
    assert config_of(Path("x"), "hrl", 2, MASTER).options == Path("x/hrl/seed-2")
    assert config_of(Path("x"), "ghrl-r", 1, MASTER).options == Path("x/ghrl/seed-1")
    assert config_of(Path("x"), "ghrl-r", 1, MASTER).rules_when_critical


def test_settings_of_a_trial_win_and_wrong_ones_are_named_before_anything_is_trained(tmp_path):
    config = config_of(tmp_path, "p-20", 3, "lane", ("steps=7",))
    assert (config.seed, config.steps, config.ppo.guided_share, config.ppo.imitated_steps) == (3, 7, 0.2, 0)
    with pytest.raises(InvalidInputError, match="did you mean 'horizon'"):
        trainings.STUDY.run(tmp_path, ['settings=["ppo.horizn=7"]'])
    assert not (tmp_path / "rows.jsonl").exists()


def test_the_stored_trainings_are_the_cells_of_the_study_and_masters_come_last():
    wanted = trainings.cells(trainings.Options())
    stored = find_trainings(RESULTS, POLICIES).rows
    assert sorted(map(cell_of, stored)) == sorted(wanted)
    assert all(cell.scenario in ARMS[cell.arm].policies for cell in wanted)
    assert {cell.scenario for cell in wanted if trainings.STUDY.phase(cell) == 1} == {MASTER}
    assert {trainings.STUDY.phase(cell) for cell in wanted} == {0, 1}


@pytest.mark.slow
def test_one_command_trains_two_arms_and_once_more_it_has_nothing_to_do(tmp_path):
    command = [*COMMAND, *choice(tmp_path, *TINY, "ppo.imitated_steps=12"), "--trainings", "0"]
    command += ["--arms", "ghrl", "hrl", "--workers", "2"]
    done = Python(*command)
    assert done.end() == 0, done.errors()
    assert "2 of 2" in done.output()
    folders = {arm: tmp_path / "runs" / arm / "seed-0" / "right" for arm in ("ghrl", "hrl")}
    rows = read_rows(tmp_path / "out")
    assert {row["arm"]: row["folder"] for row in rows} == {arm: str(folder) for arm, folder in folders.items()}
    assert all(json.loads((folder / "result.json").read_text())["finished"] for folder in folders.values())
    again = Python(*command)
    assert (again.end(), again.output()) == (0, f"rows: {tmp_path / 'out'}\n")


@pytest.mark.slow
def test_a_command_that_is_stopped_has_its_trainings_write_checkpoints_and_goes_on(tmp_path):
    tiny = [setting for setting in TINY if not setting.startswith("steps")]
    tiny.append("checkpoint_every=24")
    command = [*COMMAND, "--arms", "hrl", "--trainings", "0", "1"]
    table = tmp_path / "runs" / "hrl" / "seed-0" / "right" / "metrics.csv"
    going = Python(*command, *choice(tmp_path, *tiny, "steps=100000"))
    going.wait_for(lambda: table.exists() and len(table.read_text().splitlines()) >= 6)
    assert going.end(signal.SIGTERM) == 130
    assert going.errors().splitlines()[-1] == "stopped; the same command goes on"
    assert list(table.parent.glob("checkpoint-*"))
    assert not (tmp_path / "runs" / "hrl" / "seed-1").exists()  # what had not begun does not begin
    assert read_rows(tmp_path / "out") == []


def choice(folder: Path, *settings: str) -> list[str]:
    """Arguments of a trial in a folder."""
    options = [f"runs={folder / 'runs'}", f"settings={json.dumps(settings)}"]
    return ["--out", str(folder / "out"), "--set", *options]
