"""Every arm is trained by one command, in processes of its own, which goes on where it was."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import pytest

from dohyo.agents.hierarchical import trainings
from dohyo.agents.hierarchical.arms import ARMS, MASTER, POLICIES, SUB_POLICIES, config_of
from dohyo.agents.learning.settings import as_toml
from dohyo.sumo_networks.errors import InvalidInputError

ROOT = Path(__file__).parents[3]
RESULTS = ROOT / "agents" / "hierarchical" / "results" / "training"
TINY = ("steps=24", "held_out=1", "evaluate_every=1000", "ppo.horizon=12", "ppo.batch=12", "ppo.epochs=1")
COMMAND = (sys.executable, "-m", "dohyo.agents.hierarchical.trainings", "--policies", "right")


@pytest.mark.parametrize("folder", sorted(RESULTS.glob("*/seed-*/*")), ids=lambda path: str(path.relative_to(RESULTS)))
def test_what_results_tell_was_trained_as_the_arm_says(folder):
    arm, seed, policy = folder.relative_to(RESULTS).parts
    told = tomllib.loads(as_toml(config_of(Path("runs"), arm, int(seed.removeprefix("seed-")), policy)))
    stored = tomllib.loads((folder / "config.toml").read_text())
    assert {**stored, "options": None} == {**told, "options": None}


def test_a_master_chooses_among_its_arms_sub_policies_or_those_of_another():
    assert config_of(Path("x"), "hrl", 2, MASTER).options == Path("x/hrl/seed-2")
    assert config_of(Path("x"), "ghrl-r", 1, MASTER).options == Path("x/ghrl/seed-1")
    assert config_of(Path("x"), "ghrl-r", 1, MASTER).rules_when_critical


def test_settings_of_a_trial_win_and_wrong_ones_are_named_before_anything_is_trained(tmp_path):
    (job,) = trainings.jobs_of(tmp_path, ["p-20"], [3], ["lane"], ["steps=7"])
    config = config_of(job.runs, job.arm, job.seed, job.policy, job.more)
    assert (config.seed, config.steps, config.ppo.guided_share, config.ppo.imitated_steps) == (3, 7, 0.2, 0)
    with pytest.raises(InvalidInputError, match="did you mean 'horizon'"):
        trainings.jobs_of(tmp_path, ["p-20"], [3], ["lane"], ["ppo.horizn=7"])
    with pytest.raises(
        InvalidInputError, match="expected arms that train a policy of lane, got none: flat trains flat"
    ):
        trainings.jobs_of(tmp_path, ["flat"], [0], ["lane"])


def test_every_policy_of_the_arms_and_seeds_is_a_job_and_masters_come_last(tmp_path):
    jobs = trainings.jobs_of(tmp_path, ["ghrl", "hrl"], [0, 1], POLICIES)
    assert len(jobs) == 2 * 2 * (len(SUB_POLICIES) + 1)
    assert [job.policy for job in jobs[-4:]] == [MASTER] * 4
    assert {arm: set(one.policies) <= set(POLICIES) for arm, one in ARMS.items()} == dict.fromkeys(ARMS, True)


def test_one_command_trains_two_arms_and_once_more_it_has_nothing_to_do(tmp_path):
    command = [*COMMAND, "--arms", "hrl", "ghrl", "--workers", "2", "--out", str(tmp_path), "--set", *TINY]
    command.append("ppo.imitated_steps=12")
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert sorted(done.stdout.splitlines()) == [
        f"all 2 trained: {tmp_path}",
        *(f"trained: {tmp_path}/{arm}/seed-0/right" for arm in ("ghrl", "hrl")),
    ]
    again = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert again.stdout == f"all 2 trained: {tmp_path}\n"


def test_a_command_that_is_stopped_has_its_trainings_write_checkpoints_and_goes_on(tmp_path):
    command = [*COMMAND, "--arms", "hrl", "--seeds", "0", "1", "--out", str(tmp_path), "--set", *TINY, "steps=100000"]
    going = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    table = tmp_path / "hrl" / "seed-0" / "right" / "metrics.csv"
    while not table.exists() or len(table.read_text().splitlines()) < 3:
        assert going.poll() is None, going.communicate()
        time.sleep(0.1)
    going.send_signal(signal.SIGTERM)
    _, said = going.communicate(timeout=60)
    assert (going.returncode, said) == (130, "trainings: stopped; the same command goes on\n")
    assert not (tmp_path / "hrl" / "seed-1").exists()  # what had not begun does not begin
    steps = int(table.read_text().splitlines()[-1].partition(",")[0])
    finished = subprocess.run([*command, f"steps={steps + 12}"], cwd=ROOT, capture_output=True, text=True, check=True)
    assert finished.stdout.endswith(f"all 2 trained: {tmp_path}\n")
    result = json.loads((table.parent / "result.json").read_text())
    assert (result["finished"], result["steps"]) == (True, steps + 12)
