"""`dohyo submit` and `dohyo leaderboard`, at a service that a hand-made client stands for."""

from __future__ import annotations

import json
from typing import Any, Self

import pytest
from click.testing import Result
from typer.testing import CliRunner

from dohyo.service.cli import app
from dohyo.service.cli.commands import remote

PHASE = {"id": "rk-9f86d081", "challenge": "cup", "state": "open"}
LONG = "driver-" + "0123456789" * 7


class Service:
    """A service without a single run."""

    ranking: dict[str, str] | None = None

    def __init__(self, *address: object) -> None:
        pass

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        pass

    def leaderboard(self, *asked: object, **more: object) -> dict[str, Any]:
        return {
            "benchmark": "quickstart", "ranking": self.ranking, "metric": "driving_score", "description": "the score",
            "total": 0, "rows": [], "next": None,
        }  # fmt: skip

    def ensure_agent(self, *asked: object) -> None:
        pass

    def submit_remote(self, *asked: object) -> dict[str, Any]:
        return {"version": 1, "kind": "remote", "track": "map", "control": "target_speed_steering"}


def dohyo(monkeypatch: pytest.MonkeyPatch, *words: str, ranking: dict[str, str] | None = None) -> Result:
    monkeypatch.setattr(remote, "Client", Service)
    monkeypatch.setattr(Service, "ranking", ranking)
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.output
    return result


@pytest.mark.parametrize(
    ("ranking", "how"),
    [
        (None, ": `dohyo evaluations start AGENT quickstart --ranked --watch`"),
        (PHASE | {"challenge": None}, ": `dohyo evaluations start AGENT quickstart --ranked --watch`"),
        (PHASE, ": `dohyo evaluations start AGENT quickstart --ranking rk-9f86d081 --watch`"),
        (PHASE | {"state": "final"}, ""),
    ],
    ids=["new", "open to all", "phase", "ended phase"],
)
def test_an_empty_board_says_how_to_take_its_first_place(
    monkeypatch: pytest.MonkeyPatch, ranking: dict[str, str] | None, how: str
) -> None:
    result = dohyo(monkeypatch, "leaderboard", "quickstart", ranking=ranking)
    assert (result.stdout, result.stderr) == ("", f"no complete ranked run yet{how}\n")


def test_an_empty_board_is_the_same_document_for_programs(monkeypatch: pytest.MonkeyPatch) -> None:
    result = dohyo(monkeypatch, "leaderboard", "quickstart", "--json")
    assert (json.loads(result.stdout)["rows"], result.stderr) == ([], "")


def test_commands_to_copy_are_on_a_line_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    _, worker, following = dohyo(monkeypatch, "submit", LONG, "--remote").stdout.splitlines()
    assert worker == f"its worker: dohyo worker --server {remote.LOCAL} --agent {LONG} --entry ..."
    assert following == f"next: dohyo evaluations start {LONG} quickstart --watch"
