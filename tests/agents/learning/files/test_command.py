"""Commands: what a process was started by, as one types it."""

from __future__ import annotations

import pytest

from dohyo.agents.learning.files.command import typed


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["/usr/local/bin/dohyo", "train", "toy", "--set", "name=a b"], "dohyo train toy --set 'name=a b'"),
        (
            ["/home/me/it/dohyo/agents/studies/__main__.py", "gri", "--set", "runs=/home/me/it/out", "--out", "/tmp/a"],
            "python -m dohyo.agents.studies gri --set runs=out --out /tmp/a",
        ),
        (["/home/me/dohyo/dohyo/agents/forecasting/study/lab.py"], "python -m dohyo.agents.forecasting.study.lab"),
        (["/home/me/dohyo/.venv/bin/dohyo", "agents", "list"], "dohyo agents list"),
        (["script.py"], "script.py"),
    ],
)
def test_a_command_is_the_one_that_was_typed(arguments: list[str], told: str) -> None:
    assert typed(arguments) == told
