"""The study of GRI: every arm has settings and cells of its own, and tables decide directions."""

from __future__ import annotations

from pathlib import Path

from dohyo.agents.gri.study import arms, experts, study, tables
from dohyo.agents.gri.study.arms import ARMS, PROBLEMS, GriArm, Problem, expert_config
from dohyo.agents.gri.study.judging import JUDGED
from dohyo.agents.gri.study.study import Options, cells, evaluated_at
from dohyo.agents.gri.study.tables import claims, curves, shares
from dohyo.agents.studies.study import Results


def rows(arm: str, at_end: float, early: float) -> list[dict]:
    """Rows of all trainings, whose returns are at_end + a little and early + a little."""
    facts = {"steps": 4000, "updates": 100, "replay_demonstrated": 0.2}
    found = []
    for cell in cells(Options()):
        if cell.arm == arm:
            value = at_end if cell.benchmark.endswith("last") else early
            found.append({**cell._asdict(), **facts, "return": value + cell.training_seed + (cell.seed or 0) % 7})
    return found


def test_every_arm_has_settings_and_a_problem_and_its_own_cells():
    wanted = cells(Options())
    for name, arm in ARMS.items():
        config = arm.config(1, Path("shown"))
        assert (config.seed, config.demonstrations) == (1, "shown")
        assert config.env == (arm.env or PROBLEMS[arm.problem].env)
        mine = [cell for cell in wanted if cell.arm == name and cell.training_seed == 1]
        assert len(mine) == len(JUDGED) + len(evaluated_at(config))
    for name, problem in PROBLEMS.items():
        if problem.expert is not None:
            assert expert_config(name).env == problem.env
    assert ARMS["pendulum-sac-p0"].config(0, Path()).gri.p_demo == 0.0
    assert ARMS["pendulum-sac-noise30"].noise == 0.3


def test_encoders_are_compared_by_arms_that_see_differently_and_share_all_else():
    names = [f"driving-vis-iqn-{name}" for name in ("affordances", "classification", "untrained")]
    configs = [ARMS[name].config(0, Path("shown")) for name in names]
    assert [config.env for config in configs] == ["driving-affordances", "driving-classification", "driving-untrained"]
    assert configs[0].model_copy(update={"env": ""}) == configs[2].model_copy(update={"env": ""})
    assert len({experts.shown_in(Path(), ARMS[name]) for name in names}) == 3, "demonstrations hold encodings"
    claims = [claim for claim in tables.CLAIMS if claim.ablation == 5]
    assert [(claim.left, claim.right) for claim in claims] == [(names[0], other) for other in names[1:]]


def test_tables_tell_returns_shares_and_verdicts():
    told = rows("pendulum-sac-p0", -400.0, -1000.0) + rows("pendulum-sac-p20", -150.0, -1300.0)
    results = Results(told, {})
    table = shares(results)
    assert "| Pendulum-v1 | GRI-SAC, 20 % | 10 | 4,000 | 20 |" in table
    assert "SAC alone" in curves(results)
    verdicts = {line.split("|")[1].strip(): line for line in claims(results).splitlines()[2:]}
    assert "reproduced" in verdicts["pendulum-sac-p20 > pendulum-sac-p0"]
    dip = verdicts["pendulum-sac-p20 < pendulum-sac-p0"]
    assert "-300 n=10" in dip, "a value per training"
    assert "reproduced" in dip


def test_the_warm_up_is_decided_by_trainings_and_not_by_its_evaluations():
    alone, shown = (rows(arm, 0.0, 0.0) for arm in ("pendulum-sac-p0", "pendulum-sac-p20"))
    for row in shown:
        row["return"] += 900.0 if row["training_seed"] == 0 else -100.0
    verdicts = {line.split("|")[1].strip(): line for line in claims(Results(alone + shown, {})).splitlines()[2:]}
    assert "not resolved" in verdicts["pendulum-sac-p20 < pendulum-sac-p0"]


def test_a_run_trains_the_expert_records_it_and_gives_every_cell_a_row(tmp_path, monkeypatch):
    sizes = ("hidden=[8]", "batch=8", "round_steps=20", "learning_starts=10", "replay.capacity=2000")
    steps = ("steps=40", "evaluate_every=20", "checkpoint_every=40", "episodes=1")
    point = Problem("tests.agents.learning.problems:Point-v0", steps, sizes, steps, shown=2)
    tiny = {"point-sac-p50": GriArm("point", "sac", ("p_demo=0.5",), "GRI-SAC, half")}
    for module in (arms, experts, study, tables):
        monkeypatch.setattr(module, "PROBLEMS", {"point": point})
        monkeypatch.setattr(module, "ARMS", tiny)
    monkeypatch.setattr(study, "JUDGED", range(JUDGED.start, JUDGED.start + 2))
    options = Options(runs=tmp_path)
    wanted = [cell for cell in cells(options) if cell.training_seed in (None, 0)]
    study.prepare(options, wanted, 1)
    for arm in ("point-sac-p50", "point-expert"):
        job = [cell for cell in wanted if cell.arm == arm]
        found = list(study.work(options, job))
        assert [(row["arm"], row["seed"]) for row in found] == [(cell.arm, cell.seed) for cell in job]
        assert all(-30.0 < row["return"] < 0.0 for row in found)
    assert "GRI-SAC, half | 1 | 40 |" in shares(Results(list(study.work(options, wanted[:5])), {}))
