"""The study of GRI: every arm has settings and cells of its own, and tables decide directions."""

from __future__ import annotations

from pathlib import Path

from dohyo.agents.gri.study.arms import ARMS, PROBLEMS, expert_config
from dohyo.agents.gri.study.study import JUDGED, Options, cells, evaluated_at
from dohyo.agents.gri.study.tables import claims, curves, shares
from dohyo.agents.studies.study import Results


def rows(arm: str, at_end: float, early: float) -> list[dict]:
    """Rows of three trainings, whose returns are at_end + a little and early + a little."""
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
        assert (config.seed, config.env, config.demonstrations) == (1, PROBLEMS[arm.problem].env, "shown")
        mine = [cell for cell in wanted if cell.arm == name and cell.training_seed == 1]
        assert len(mine) == len(JUDGED) + len(evaluated_at(config))
    for name, problem in PROBLEMS.items():
        if problem.expert is not None:
            assert expert_config(name).env == problem.env
    assert ARMS["pendulum-sac-p0"].config(0, Path()).gri.p_demo == 0.0
    assert ARMS["pendulum-sac-noise30"].noise == 0.3


def test_tables_tell_returns_shares_and_verdicts():
    told = rows("pendulum-sac-p0", -400.0, -1000.0) + rows("pendulum-sac-p20", -150.0, -1300.0)
    results = Results(told, {})
    table = shares(results)
    assert "| Pendulum-v1 | GRI-SAC, 20 % | 3 | 4,000 | 20 |" in table
    assert "SAC alone" in curves(results)
    verdicts = {line.split("|")[1].strip(): line for line in claims(results).splitlines()[2:]}
    assert "reproduced" in verdicts["pendulum-sac-p20 > pendulum-sac-p0"]
    assert "reproduced" in verdicts["pendulum-sac-p20 < pendulum-sac-p0"], "the dip of the warm-up"
