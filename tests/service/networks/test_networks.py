from __future__ import annotations

import bz2
import gzip
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dohyo.service.errors import ConflictError
from dohyo.service.jobs.kind import Task
from dohyo.service.networks import finding, kinds
from dohyo.service.networks.map import map_document
from dohyo.service.worlds.model import World, WorldStatus
from dohyo.service.worlds.queries import finish_world
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.networks.conversion.source_file import ImportOptions
from dohyo.sumo_networks.networks.entries import network_path
from dohyo.sumo_networks.networks.importing import retract_network
from dohyo.sumo_networks.networks.network import RoadNetwork
from tests.extracts import BLACKPOOL, as_pbf, crossroads
from tests.service.harness import Caller, Harness, assert_problem, patiently, running

PLAIN = b"""<net version="1.20" junctionCornerDetail="5" limitTurnSpeed="5.50">
    <location netOffset="0.00,0.00" convBoundary="0.00,0.00,200.00,0.00" origBoundary="0,0,200,0" projParameter="!"/>
    <edge id="a" from="n0" to="n1" priority="1">
        <lane id="a_0" index="0" speed="13.89" length="100.00" shape="0.00,-1.60 100.00,-1.60"/>
    </edge>
    <edge id="b" from="n1" to="n2" priority="1">
        <lane id="b_0" index="0" speed="13.89" length="100.00" shape="100.00,-1.60 200.00,-1.60"/>
    </edge>
    <junction id="n0" type="dead_end" x="0.00" y="0.00" incLanes="" intLanes="" shape="0.00,0.00 0.00,-3.20"/>
    <junction id="n1" type="priority" x="100.00" y="0.00" incLanes="a_0" intLanes=""
        shape="100.00,0.00 100.00,-3.20 100.00,0.00"><request index="0" response="0" foes="0" cont="0"/></junction>
    <junction id="n2" type="dead_end" x="200.00" y="0.00" incLanes="b_0" intLanes="" shape="200.00,-3.20 200.00,0.00"/>
    <connection from="a" to="b" fromLane="0" toLane="0" dir="s" state="M"/>
</net>"""


def upload(caller: Caller, content: bytes, file: str = "town.net.xml", **fields: str) -> Any:
    form = {"name": "my-town", **fields}
    files = {"file": (file, content)}
    return patiently(
        lambda prefer: caller.client.post("/v1/networks", data=form, files=files, headers=caller.headers | prefer)
    )


def test_networks_are_listed_with_what_they_hold(service: Harness) -> None:
    listed = {one["name"]: one for one in service.client.get("/v1/networks").json()}
    one = service.client.get("/v1/networks/ingolstadt").json()
    assert one == listed["ingolstadt"]
    network = load_network("ingolstadt")
    assert one["sha256"] == network.sha256
    assert one["crossings"] == int(network.lanes.crossing.sum())
    assert one["origin"] == "dohyo"


def test_networks_are_loaded_once_for_their_list(service: Harness, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where there is one more than are kept in memory, each list would load them all again."""
    paths, loaded = ("/v1/networks", "/v1/networks/ingolstadt"), list[str]()
    first = [service.client.get(path).json() for path in paths]

    def noted(name: str) -> RoadNetwork:
        loaded.append(name)
        return load_network(name)

    monkeypatch.setattr(finding, "load_network", noted)
    assert [service.client.get(path).json() for path in paths] == first
    assert loaded == []


def test_a_name_that_was_given_to_another_network_shows_the_new_one(service: Harness) -> None:
    folder = service.services.settings.data / "networks" / "town"
    folder.mkdir(parents=True)
    (folder / "network.toml").write_text('title = "Town"\nsource = "made"\nlicence = "CC0"\nfile = "town.net.xml"\n')
    seen = []
    for net in (PLAIN, PLAIN.replace(b"200.00", b"250.00")):
        (folder / "town.net.xml").write_bytes(net)
        seen.append(service.client.get("/v1/networks/town").json())
    assert [one["bounds"][2] for one in seen] == [200.0, 250.0]
    assert seen[0]["sha256"] != seen[1]["sha256"]


def test_the_offset_of_a_network_from_its_source_is_told(service: Harness) -> None:
    folder = service.services.settings.data / "networks" / "town"
    folder.mkdir(parents=True)
    (folder / "network.toml").write_text('title = "Town"\nsource = "made"\nlicence = "CC0"\nfile = "town.net.xml"\n')
    offset = b"netOffset = '1.5e3,-20.25'"
    (folder / "town.net.xml").write_bytes(PLAIN.replace(b'netOffset="0.00,0.00"', offset))
    assert service.client.get("/v1/networks/town").json()["net_offset"] == [1500.0, -20.25]
    assert service.client.get("/v1/networks/ingolstadt").json()["net_offset"] == [-672401.23, -5399632.08]


def test_a_path_is_no_name(service: Harness) -> None:
    inside = str(network_path("ingolstadt")).replace("/", "%2F")
    for name in (inside, "..%2Fingolstadt", "ingolstadt.net.xml", "%00"):
        assert service.client.get(f"/v1/networks/{name}").status_code in (404, 422)
        assert service.client.get(f"/v1/networks/{name}/map").status_code in (404, 422)


def test_the_map_of_a_box_holds_what_reaches_into_it(service: Harness) -> None:
    network = load_network("ingolstadt")
    x, y, _ = network.lane_point(int(np.flatnonzero(network.lanes.drivable)[0]), 1.0)
    part = service.client.get(
        "/v1/networks/ingolstadt/map", params={"x0": x - 50, "y0": y - 50, "x1": x + 50, "y1": y + 50}
    ).json()
    whole = map_document(network)
    assert 0 < len(part["lanes"]) < len(whole["lanes"])
    assert all(lane in whole["lanes"] for lane in part["lanes"])
    expected = [
        lane
        for lane in whole["lanes"]
        if min(p[0] for p in lane["points"]) <= x + 50
        and max(p[0] for p in lane["points"]) >= x - 50
        and min(p[1] for p in lane["points"]) <= y + 50
        and max(p[1] for p in lane["points"]) >= y - 50
    ]
    assert len(part["lanes"]) == len(expected)
    assert {lane["kind"] for lane in whole["lanes"]} <= {"drive", "bicycle", "walk", "crossing", "internal"}
    assert len(whole["stop_lines"]) == len(network.stop_lines.lane)
    assert all(math.isfinite(value) for line in whole["stop_lines"] for value in line)


def test_a_map_is_packed_and_is_not_sent_twice(service: Harness) -> None:
    path = "/v1/networks/ingolstadt/map?x0=0&y0=0&x1=9000&y1=9000"
    plain = service.client.get(path, headers={"accept-encoding": "identity"})
    packed = service.client.get(path, headers={"accept-encoding": "gzip"})
    assert "content-encoding" not in plain.headers
    assert packed.headers["content-encoding"] == "gzip"
    assert packed.json() == plain.json()
    assert packed.num_bytes_downloaded < len(plain.content) / 3
    again = service.client.get(path, headers={"if-none-match": packed.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")


@pytest.mark.parametrize(
    "query", ["x0=1", "x0=1&y0=1&x1=0&y1=2", "x0=nan&y0=0&x1=1&y1=1", "x0=-inf&y0=0&x1=1&y1=1", "x0=a&y0=0&x1=1&y1=1"]
)
def test_boxes_that_are_none(service: Harness, query: str) -> None:
    assert_problem(service.client.get(f"/v1/networks/ingolstadt/map?{query}"), 422)


@pytest.mark.slow
def test_an_uploaded_network_lives_in_the_data_folder_and_never_changes(
    service: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And another owner's job that was ordered at the same time does not take it."""
    team, real, refusals = service.caller("team"), kinds.import_confined, list[str]()

    def then_the_other(file: Path, name: str, options: ImportOptions, **more: Any) -> None:
        real(file, name, options, **more)
        given = {"name": name, "suffix": ".net.xml", "options": {}}
        other = Task("job-other", "other", given, file, service.services)
        with pytest.raises(ConflictError) as refused:
            kinds.import_roads(other)
        refusals.append(str(refused.value))

    monkeypatch.setattr(kinds, "import_confined", then_the_other)
    made = upload(team, gzip.compress(PLAIN), "town.net.xml.gz", licence="CC0")
    assert made.status_code == 201, made.text
    assert refusals == ["network 'my-town' exists or is being imported; choose another name"]
    body = made.json()
    assert (body["name"], body["origin"], body["licence"], body["lanes"]) == ("my-town", "upload", "CC0", 2)
    data = service.services.settings.data
    assert (data / "networks" / "my-town" / "network.toml").is_file()
    assert "my-town" in [one["name"] for one in service.client.get("/v1/networks").json()]
    assert service.client.get("/v1/networks/my-town/map").json()["lanes"]
    assert_problem(upload(team, PLAIN), 409, "never change")
    assert_problem(service.caller("other").delete("/v1/networks/my-town"), 403, "not yours")
    assert_problem(team.delete("/v1/networks/ingolstadt"), 403, "not yours")
    with service.services.database.session() as session:
        session.add(World(id="wo-1", owner="other", order={"scenario": {"network": "my-town"}}))
    assert_problem(team.delete("/v1/networks/my-town"), 409, "world 'wo-1' drives on network 'my-town'")
    with service.services.database.session() as session:
        finish_world(session, "wo-1", WorldStatus.DONE, None, 0, None)
    retract_network("my-town")  # as by a deletion that was cut off after it: the row is still there
    assert team.delete("/v1/networks/my-town").status_code == 204
    assert not (data / "networks" / "my-town").exists()
    assert_problem(service.client.get("/v1/networks/my-town"), 404)
    assert_problem(team.delete("/v1/networks/my-town"), 404)
    assert upload(team, PLAIN).status_code == 201
    assert team.delete("/v1/networks/my-town").status_code == 204


@pytest.mark.slow
def test_a_service_in_a_folder_that_is_told_from_here_takes_networks_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The process that reads them works in another folder."""
    monkeypatch.chdir(tmp_path)
    with running(Path("dohyo-data")) as service:
        made = upload(service.caller("team"), PLAIN)
    assert made.status_code == 201, made.text


def test_an_extract_is_unpacked_and_mirrored_as_its_country_says(service: Harness, tmp_path: Path) -> None:
    team, there = service.caller("team"), tmp_path / "blackpool.osm"
    there.write_text(crossroads(BLACKPOOL), encoding="utf-8")
    chosen = {"name": "chosen", "side": "right", "country": "DE", "largest_part": "true", "fix": "true"}
    usual = upload(team, bz2.compress(there.read_bytes()), "Blackpool.OSM.BZ2").json()
    right = upload(team, as_pbf(there).read_bytes(), "blackpool.osm.pbf", **chosen).json()
    assert (usual["mirrored"], right["mirrored"]) == (True, False)
    assert usual["guessed"][0].startswith("country GB")
    assert right["guessed"][0].startswith("country DE")
    assert usual["lanes"] == right["lanes"]


@pytest.mark.parametrize(
    ("content", "file", "fields", "status", "says"),
    [
        (PLAIN, "town.net.xml", {"name": "../../etc"}, 422, "network name"),
        (PLAIN, "town.net.xml", {"name": ""}, 422, "network name"),
        (PLAIN, "town.net.xml", {"name": "ingolstadt"}, 409, "ingolstadt"),
        (PLAIN, "town.zip", {}, 422, ".net.xml"),
        (PLAIN, "town.net.xml", {"lights": "maybe"}, 422, "lights"),
        (PLAIN, "town.net.xml", {"side": "both"}, 422, "side: expected left or right"),
        (PLAIN, "town.net.xml", {"country": "Atlantis"}, 422, "no country named 'ATLANTIS'"),
        (PLAIN, "town.net.xml", {"country": "GB"}, 422, "OpenStreetMap files only"),
        (PLAIN, "town.net.xml", {"licence": "a\nb"}, 422, "licence"),
        (b"<net></nonsense>", "town.net.xml", {}, 422, "XML"),
        (b'<!DOCTYPE net [<!ENTITY a SYSTEM "file:///etc/passwd">]><net>&a;</net>', "t.net.xml", {}, 422, "DOCTYPE"),
        (b"\x1f\x8b\x08garbage", "town.net.xml.gz", {}, 422, "gzip"),
        (b"<net/>", "../../../../tmp/evil.net.xml", {}, 422, "lane"),
    ],
)
def test_what_is_no_network_is_refused_and_leaves_nothing(
    service: Harness, content: bytes, file: str, fields: dict[str, str], status: int, says: str
) -> None:
    answer = upload(service.caller("team"), content, file, **fields)
    assert_problem(answer, status, says)
    assert "/tmp/" not in answer.text
    folder = service.services.settings.data / "networks"
    assert not folder.exists() or list(folder.iterdir()) == []


def test_a_full_disk_during_an_import_is_told_as_such(service: Harness, monkeypatch: pytest.MonkeyPatch) -> None:
    from dohyo.service.errors import StorageFullError

    def full(*_: object, **__: object) -> None:
        raise StorageFullError()

    monkeypatch.setattr("dohyo.service.networks.importing.run", full)
    assert_problem(upload(service.caller("team"), PLAIN), 507)
    assert not Path(service.services.settings.data / "networks").exists()
