"""Trained sub-policies on many held-out exercises: the same for all, once each, and judged with intervals."""

from __future__ import annotations

import pytest
import torch

from dohyo.agents.hierarchical.environments.manoeuvre_env import ManoeuvreEnv
from dohyo.agents.hierarchical.hierarchy import read_sub_policies
from dohyo.agents.hierarchical.study import evaluate_policies, held_out_tables
from dohyo.agents.hierarchical.training.tasks import ManoeuvreTask
from dohyo.agents.studies.arms import Cell
from dohyo.agents.studies.rows import cell_of, read_rows
from dohyo.agents.studies.study import Results
from dohyo.agents.studies.training_results import run_folder
from dohyo.sumo_networks.errors import InvalidInputError
from tests.agents.hierarchical.untrained import write_sub_policies

FIRST = evaluate_policies.FIRST


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Arms hrl and p-20 with two trainings of lane."""
    folder = tmp_path_factory.mktemp("runs")
    for arm in ("hrl", "p-20"):
        for seed in (0, 1):
            write_sub_policies(run_folder(folder, arm, seed, "lane").parent, ("lane",))
    return folder


def test_the_stored_rows_are_the_cells_of_the_study():
    wanted = evaluate_policies.cells(evaluate_policies.Options())
    assert sorted(map(cell_of, read_rows(evaluate_policies.STUDY.stored))) == sorted(wanted)


def test_each_training_drives_each_exercise_once_and_a_second_call_the_missing_ones(runs, tmp_path):
    settings, study = [f"runs={runs}"], evaluate_policies.STUDY

    def chosen(seeds, arms):
        return lambda cell: (
            cell.benchmark == "lane" and cell.arm in arms and cell.training_seed in (0, 1) and cell.seed < FIRST + seeds
        )

    study.run(tmp_path, settings, chosen=chosen(2, ("hrl", "p-20")))
    study.run(tmp_path, settings, chosen=chosen(3, ("hrl",)))
    rows = read_rows(tmp_path)
    assert sorted((row["arm"], row["training_seed"], row["seed"] - FIRST) for row in rows) == [
        *(("hrl", seed, number) for seed in (0, 1) for number in (0, 1, 2)),
        *(("p-20", seed, number) for seed in (0, 1) for number in (0, 1)),
    ]
    text = held_out_tables.tables(Results(rows, {}))
    assert "| lane | hrl | 0, 1 | " in text
    assert "| lane | p-20 > hrl | return | +0, +0 | 0" in text  # the same network drove the same exercises


def test_an_exercise_is_driven_as_its_environment_alone_is(runs):
    trained = read_sub_policies(run_folder(runs, "hrl", 0, "lane").parent, ("lane",))
    policy = trained.policies["lane"]
    exercise = ManoeuvreEnv(ManoeuvreTask("lane", trained.state, steering=trained.steering))
    totals = []
    try:
        for number in (0, 1):
            state, _ = exercise.reset(seed=FIRST + number)
            total, ended = 0.0, False
            while not ended:
                action = policy.actor(torch.from_numpy(state)[None])[0].detach().numpy()
                state, reward, terminated, truncated, _ = exercise.step(action)
                total, ended = total + reward, terminated or truncated
            totals.append(total)
    finally:
        exercise.close()
    job = [Cell("hrl", 0, "lane", "held-out", FIRST + number) for number in (0, 1)]
    rows = list(evaluate_policies.work(evaluate_policies.Options(runs=runs), job))
    assert [row["seed"] for row in rows] == [FIRST, FIRST + 1]
    assert [row["return"] for row in rows] == pytest.approx(totals, abs=1e-3)


def test_tables_hold_arms_against_each_other_on_what_both_drove():
    rows = [
        {**Cell(arm, seed, "lights", "held-out", n)._asdict(), "return": base + n, "success": 100.0, "infraction": 0.0}
        for arm, base in (("hrl", 10.0), ("p-20", 20.0))
        for seed in (0, 1, 2)
        for n in range(12)
    ]
    means, claims = held_out_tables.tables(Results(rows, {})).split("\n\n")
    assert means.splitlines()[2].startswith("| lights | hrl | 0, 1, 2 | 15.5 [")
    assert "| lights | p-20 > hrl | return | +10, +10, +10 | 10.0 [10.0, 10.0] n=36 | 0.001 | reproduced |" in claims
    assert "| lights | p-20 < hrl | infractions, % | +0, +0, +0 | 0 [0, 0] n=36 | 1.00 | not resolved |" in claims


def test_a_missing_training_is_named(runs, tmp_path):
    with pytest.raises(InvalidInputError, match=r"no 'lane' in '.*p-5/seed-0'"):
        evaluate_policies.STUDY.run(
            tmp_path, [f"runs={runs}"], chosen=lambda cell: (cell.arm, cell.benchmark) == ("p-5", "lane")
        )
