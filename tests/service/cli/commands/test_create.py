"""`dohyo benchmarks create` and `dohyo demo`: one file, one error, one report; a second run drives nothing again."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from dohyo.service.cli import app
from dohyo.sumo_networks.errors import InvalidInputError
from tests.extracts import crossroads

OSM = crossroads()


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("DOHYO_HOME", str(tmp_path / "home"))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def dohyo(*words: str) -> str:
    done = CliRunner().invoke(app, [*words], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.output


def test_the_same_seed_gives_the_same_file_and_an_existing_file_stays(folder: Path) -> None:
    command = ("benchmarks", "create", "mine", "--network", "town-test", "--missions", "4", "--length", "200-500")
    dohyo(*command)
    first = (folder / "mine.toml").read_bytes()
    with pytest.raises(InvalidInputError, match=r"'mine.toml' exists"):
        dohyo(*command)
    dohyo(*command, "--force")
    assert (folder / "mine.toml").read_bytes() == first
    dohyo(*command, "--force", "--seed", "1")
    assert (folder / "mine.toml").read_bytes() != first
    lengths = [one["length_m"] for one in json.loads(dohyo(*command, "--force", "--json"))["missions"]]
    assert all(200 <= length <= 500 for length in lengths)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--length", "long"), "--length 'long': expected two lengths"),
        (("--length", "500-200"), "--length '500-200'"),
        (("--length", "9000-9100"), "its routes are 31 to 758 m long"),
        (("--missions", "1000"), "expected 1000"),
        (("--traffic", "some"), "amount of traffic named 'some'"),
        (("--events", "meteor"), "kind of event named 'meteor'"),
    ],
)
def test_bad_input_is_one_clear_error_and_no_file(options: tuple[str, str], message: str, folder: Path) -> None:
    with pytest.raises(InvalidInputError, match=message):
        dohyo("benchmarks", "create", "mine", "--network", "town-test", *options)
    assert not list(folder.iterdir())


def test_a_shipped_benchmark_is_not_shadowed() -> None:
    with pytest.raises(InvalidInputError, match="'nocrash' comes with dohyo"):
        dohyo("benchmarks", "create", "nocrash", "--network", "town-test")


def test_from_a_file_to_a_report_and_nothing_is_driven_twice(folder: Path) -> None:
    (folder / "Cross Roads.osm").write_text(OSM)
    out = dohyo("demo", "Cross Roads.osm", "--missions", "1", "--workers", "1")
    results = folder / "out" / "demo" / "cross-roads"
    assert f"report: {results / 'report.html'}" in out.splitlines()
    records = sorted(results.glob("*/records/*.json"))
    assert len(records) == 4
    written = [record.stat().st_mtime_ns for record in records]
    dohyo("demo", "Cross Roads.osm", "--missions", "1", "--workers", "1")
    assert [record.stat().st_mtime_ns for record in records] == written
    (folder / "Cross Roads.osm").write_text(OSM.replace("52.5035", "52.5036"))
    with pytest.raises(InvalidInputError, match="network 'cross-roads' exists and comes from other data"):
        dohyo("demo", "Cross Roads.osm")
