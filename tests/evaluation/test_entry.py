from __future__ import annotations

from pathlib import Path

import pytest

from dohyo.evaluation.agent import make_agent
from dohyo.evaluation.entry import load_entry, make_entry
from dohyo.sumo_networks.errors import InvalidInputError


def test_an_entry_is_loaded_and_called() -> None:
    assert load_entry("pathlib:Path", "thing") is Path
    assert make_entry("fractions:Fraction", "thing", {"numerator": 3}) == 3


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ("Mine", "expected a registered name or 'module:name'"),
        ("nowhere.at_all:Mine", "module 'nowhere.at_all' cannot be imported: ModuleNotFoundError: No module named"),
        ("broken_module_of_mine:Mine", "cannot be imported: SyntaxError"),
        ("several_lines_of_mine:Mine", "cannot be imported: RuntimeError: first$"),
        ("exits_module_of_mine:Mine", "cannot be imported: SystemExit: 0$"),
        ("pathlib:Mine", "module 'pathlib' has no 'Mine'"),
        ("fractions:Fraction", "agent 'fractions:Fraction' has no spec, reset, act"),
    ],
)
def test_what_is_wrong_is_one_line_with_module_and_cause(
    entry: str, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "broken_module_of_mine.py").write_text("def f(:\n")
    (tmp_path / "several_lines_of_mine.py").write_text("raise RuntimeError('first\\nsecond')\n")
    (tmp_path / "exits_module_of_mine.py").write_text("raise SystemExit(0)\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(InvalidInputError, match=message) as raised:
        make_agent(entry)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("entry", "known"),
    [
        ("dohyo.agents.experts.autopilot:Autopilot", "max_speed"),
        ("dohyo.agents.experts.pdm:PdmClosed", "variant"),
        ("dohyo.agents.mcts.mbappe:Mbappe", "prior_variance"),
    ],
)
def test_an_unknown_setting_names_the_known_ones(entry: str, known: str) -> None:
    with pytest.raises(InvalidInputError, match="setting 'prior_': unknown") as raised:
        make_agent(entry, {"prior_": 1})
    assert known in str(raised.value)
