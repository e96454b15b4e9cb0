"""Trained sub-policies on many held-out exercises: the same for all, once each, and told with intervals."""

from __future__ import annotations

import pytest

from dohyo.agents.hierarchical import evaluate_policies
from dohyo.agents.hierarchical.arms import run_folder
from dohyo.agents.hierarchical.hierarchy import read_sub_policies
from dohyo.agents.hierarchical.tasks import ManoeuvreTask
from dohyo.agents.learning.evaluation import evaluate
from dohyo.agents.learning.task import SINGLE
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import read_lines
from tests.agents.hierarchical.untrained import write_sub_policies


class First(ManoeuvreTask):
    """Judged by the first two exercises that are here."""

    held_out = (evaluate_policies.FIRST, evaluate_policies.FIRST + 1)


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Arms hrl and p-20 with two trainings of lane."""
    folder = tmp_path_factory.mktemp("runs")
    for arm in ("hrl", "p-20"):
        for seed in (0, 1):
            write_sub_policies(run_folder(folder, arm, seed, "lane").parent, ("lane",))
    return folder


def command(runs, out, *more):
    evaluate_policies.main(["--runs", str(runs), "--policies", "lane", "--seeds", "0", "1", "--out", str(out), *more])


def test_each_training_drives_each_exercise_once_and_more_go_on_where_it_was(runs, tmp_path, capsys):
    command(runs, tmp_path, "--arms", "hrl", "p-20", "--episodes", "2", "--workers", "2")
    lines = read_lines(tmp_path / "lane.jsonl")
    assert sorted((one["arm"], one["training_seed"], one["episode"]) for one in lines) == [
        (arm, seed, episode) for arm in ("hrl", "p-20") for seed in (0, 1) for episode in (0, 1)
    ]
    told = capsys.readouterr().out
    assert "| lane | hrl | 0, 1 | " in told
    assert "| lane | p-20 - hrl | return | 0" in told  # the same network drove the same exercises
    before = (tmp_path / "lane.jsonl").read_text()
    (tmp_path / "lane.jsonl").write_text(before + '{"arm": "hr')
    command(runs, tmp_path, "--arms", "hrl", "--episodes", "3")
    lines = read_lines(tmp_path / "lane.jsonl")
    assert sorted(one["episode"] for one in lines if one["arm"] == "hrl") == [0, 0, 1, 1, 2, 2]


def test_an_exercise_is_driven_as_a_training_evaluates(runs):
    trained = read_sub_policies(run_folder(runs, "hrl", 0, "lane").parent, ("lane",))
    task = First("lane", trained.state, steering=trained.steering)
    actor = trained.policies["lane"].actor
    environments = task.make_environments(1, processes=True)
    try:
        told = evaluate(task, environments, lambda seen: evaluate_policies.chosen(actor, seen[SINGLE][0].numpy())[None])
    finally:
        environments.close()
    candidate = evaluate_policies.Candidate("lane", "hrl", 0, run_folder(runs, "hrl", 0, "lane"))
    lines = evaluate_policies.examine(candidate, [0, 1])
    assert [one["return"] for one in lines] == pytest.approx([one.total for one in told.outcomes], abs=1e-3)
    assert [one["success"] > 0 for one in lines] == [one.success for one in told.outcomes]


def test_tables_hold_arms_against_each_other_on_what_both_drove():
    lines = [
        {"arm": arm, "training_seed": seed, "episode": n, "return": base + n, "success": 100.0, "infraction": 0.0}
        for arm, base in (("hrl", 10.0), ("p-20", 20.0))
        for seed in (0, 1)
        for n in range(4)
    ]
    sums, pairs = evaluate_policies.tables({"lights": lines}).split("\n\n")
    assert sums.splitlines()[2].startswith("| lights | hrl | 0, 1 | 11.5 [")
    assert "| lights | p-20 - hrl | return | 10.0 [10.0, 10.0] n=8 | +10, +10 | above |" in pairs
    assert "| lights | p-20 - hrl | success, % | 0 [0, 0] n=8 | +0, +0 | no |" in pairs


def test_what_is_missing_is_named_before_anything_is_driven(runs, tmp_path):
    with pytest.raises(InvalidInputError, match=r"no 'lane' in '.*p-5/seed-0'"):
        command(runs, tmp_path / "out", "--arms", "p-5")
    with pytest.raises(InvalidInputError, match=r"expected exercises in POLICY.jsonl, found none"):
        evaluate_policies.main(["--table", "--out", str(tmp_path)])
    with pytest.raises(InvalidInputError, match="expected --runs, or --table"):
        evaluate_policies.main(["--out", str(tmp_path)])
    assert not (tmp_path / "out").exists()
