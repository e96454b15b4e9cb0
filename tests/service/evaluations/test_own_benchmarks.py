"""An organiser's own benchmarks: files in the data folder, on uploaded networks."""

from __future__ import annotations

import json
from pathlib import Path

import httpx
import pytest

from dohyo.service.client.client import Client
from tests.extracts import grid
from tests.service.harness import Harness, assert_problem, patiently
from tests.service.serving import Served, command, serving

MINE = """
name = "mine"
description = "One mission of my own"
headline = "driving_score"
metric = "driving score"
seeds = [0]
network = "ingolstadt"
missions = [{ name = "m01", start = { lane = "737320747#3_2" }, goal = { lane = "737320747#4_2" } }]
"""
PATIENCE_S = 240.0


def place(data: Path, file: str, text: str) -> None:
    (data / "benchmarks").mkdir(exist_ok=True)
    (data / "benchmarks" / f"{file}.toml").write_text(text)


def listed(service: Harness) -> list[str]:
    return [one["name"] for one in service.client.get("/v1/benchmarks").json()]


def test_a_file_in_the_data_folder_is_a_benchmark_as_those_that_ship(service: Harness) -> None:
    shipped = listed(service)
    assert_problem(service.client.get("/v1/benchmarks/mine"), 404, "mine")
    place(service.services.settings.data, "mine", MINE)
    assert listed(service) == [*shipped, "mine"]
    one = service.client.get("/v1/benchmarks/mine").json()
    assert (one["networks"], one["seeds"], one["scenarios"]) == (["ingolstadt"], [0], 1)
    team = service.caller("team")
    team.agent("pilot")
    evaluation = team.get(f"/v1/evaluations/{team.evaluation('pilot', 'mine', ranked=True)}").json()
    assert (evaluation["benchmark"], evaluation["benchmark_version"]) == ("mine", one["version"])
    place(service.services.settings.data, "mine", MINE.replace("seeds", "rules = '1.0'\nseeds"))
    versions = service.client.get("/v1/benchmarks/mine/versions").json()
    assert [version["current"] for version in versions] == [True, False]
    assert versions[1]["version"] == one["version"]


@pytest.mark.parametrize(
    ("file", "text", "says"),
    [
        ("mine", "name = ", "'mine.toml' is not valid TOML"),
        ("mine", MINE.replace("headline", "heading"), "headline"),
        ("other", MINE, "name: expected 'other', got 'mine'"),
        ("mine", MINE.replace('"ingolstadt"', '"atlantis"'), "this service has no network 'atlantis'"),
        ("mine", MINE.replace('"ingolstadt"', '"/etc/x.net.xml"'), "this service has no network '/etc/x.net.xml'"),
        ("mine", 'kind = "parking"\n' + MINE, "expected a benchmark of driving"),
    ],
)
def test_a_faulty_file_is_told_and_leaves_the_others_as_they_are(
    service: Harness, file: str, text: str, says: str, caplog: pytest.LogCaptureFixture
) -> None:
    shipped = listed(service)
    place(service.services.settings.data, file, text)
    assert listed(service) == shipped
    assert any(says in line.getMessage() for line in caplog.records)
    answer = service.client.get(f"/v1/benchmarks/{file}")
    assert_problem(answer, 422, says)
    assert str(service.services.settings.data) not in answer.text


def test_only_files_of_the_organisers_own_are_sent(service: Harness) -> None:
    place(service.services.settings.data, "mine", MINE)
    answer = service.client.get("/v1/benchmarks/mine/file")
    assert (answer.text, answer.headers["content-type"]) == (MINE, "application/toml")
    for name in ("quickstart", "other", "..%2Fmine"):
        assert service.client.get(f"/v1/benchmarks/{name}/file").status_code == 404


def test_a_shipped_benchmark_keeps_its_name(service: Harness) -> None:
    before = service.client.get("/v1/benchmarks/quickstart").json()
    place(service.services.settings.data, "quickstart", MINE.replace('"mine"', '"quickstart"'))
    assert service.client.get("/v1/benchmarks/quickstart").json() == before
    assert listed(service).count("quickstart") == 1


@pytest.mark.slow
def test_agents_are_ranked_and_verified_on_an_uploaded_city(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As the page tells it: upload, draw missions, copy the file."""
    with serving(tmp_path / "data") as served, Client(served.url, served.token) as client:
        upload(served, tmp_path)
        monkeypatch.setenv("DOHYO_HOME", str(tmp_path / "data"))
        out = str(tmp_path / "data" / "benchmarks" / "mine.toml")
        drawn = ("--network", "city", "--missions", "1", "--traffic", "empty", "--seeds", "0", "--out", out)
        assert command("benchmarks", "create", "mine", *drawn).exit_code == 0
        client.register_agent("pilot")
        client.submit_builtin("pilot", "autopilot")
        ended = client.wait(client.evaluate("pilot", "mine", ranked=True)["id"], PATIENCE_S)
        assert (ended["status"], ended["progress"]["done"]) == ("done", 1)
        assert [row["agent"] for row in client.leaderboard("mine")["rows"]] == ["pilot"]
        (episode,) = client.episodes(ended["id"])
        assert served.ask("POST", f"/v1/episodes/{episode['id']}/verify")["same"]
        monkeypatch.setenv("DOHYO_HOME", str(tmp_path / "home"))
        take_along(served, tmp_path, episode["record_hash"])
        refused = httpx.delete(
            f"{served.url}/v1/networks/city", headers={"authorization": f"Bearer {served.token}"}, timeout=120
        )
        assert_problem(refused, 409, "benchmark 'mine' of this service drives on network 'city'")


def take_along(served: Served, folder: Path, record_hash: str) -> None:
    """Imports the city and copies the benchmark elsewhere, by the service's answers alone; it drives the same there."""
    headers = {"authorization": f"Bearer {served.token}"}
    for path, name in (("networks/city/net", "city.net.xml.gz"), ("benchmarks/mine/file", "mine.toml")):
        answer = httpx.get(f"{served.url}/v1/{path}", headers=headers, timeout=120)
        assert answer.status_code == 200, answer.text
        (folder / name).write_bytes(answer.content)
    assert command("networks", "import", str(folder / "city.net.xml.gz"), "--name", "city").exit_code == 0
    drive = ("--agent", "autopilot", "--benchmark", str(folder / "mine.toml"), "--out", str(folder / "out"))
    assert command("evaluate", *drive, "--workers", "1").exit_code == 0
    (record,) = (folder / "out" / "records").glob("*.json")
    assert json.loads(record.read_text())["record_hash"] == record_hash


def upload(served: Served, folder: Path) -> None:
    """Has a service import a small city."""
    headers, path = {"authorization": f"Bearer {served.token}"}, f"{served.url}/v1/networks"
    content = {"file": ("city.osm", grid().encode())}
    form = {"name": "city", "largest_part": "true"}
    answer = patiently(lambda prefer: httpx.post(path, data=form, files=content, headers=headers | prefer, timeout=120))
    assert answer.status_code == 201, answer.text
