"""The guard: a road file that was never imported is trusted no more than one that is, and leaves nothing behind."""

from __future__ import annotations

import gzip
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks import catalog
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.networks.xml_guard import scan
from dohyo.sumo_networks.routes.routing import plan_route
from dohyo.sumo_networks.scenario import Mission, Place
from tests.worlds import straight_road

NET = straight_road().network.path.read_bytes()
BOMB = b'<!DOCTYPE net [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;">]><net>&b;&b;</net>'
EXTERNAL = b'<!DOCTYPE net [<!ENTITY x SYSTEM "file:///etc/passwd">]><net>&x;</net>'
NO_LANES = (
    b'<net version="1.20"><location netOffset="0,0" convBoundary="0,0,1,1" origBoundary="0,0,1,1" projParameter="!"/>'
    b"</net>"
)


@pytest.fixture(autouse=True)
def homes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[], list[Path]]:
    """Lists what has been written where dohyo keeps things."""
    for variable in ("DOHYO_CACHE", "DOHYO_HOME"):
        monkeypatch.setenv(variable, str(tmp_path / variable))
    return lambda: [path for path in (tmp_path / v for v in ("DOHYO_CACHE", "DOHYO_HOME")) if path.exists()]


HOSTILE = {
    "bomb": (BOMB, "DOCTYPE"),
    "external entity": (EXTERNAL, "DOCTYPE"),
    "external DTD": (b'<!DOCTYPE net SYSTEM "http://127.0.0.1:9/x.dtd"><net/>', "DOCTYPE"),
    "bomb in UTF-16": (('<?xml version="1.0" encoding="UTF-16"?>' + BOMB.decode()).encode("utf-16"), "DOCTYPE"),
    "DOCTYPE after 70 kB": (b"<!--" + b" " * 70_000 + b"-->" + BOMB, "DOCTYPE"),
    "undefined entity": (b"<net>&x;</net>", "well-formed"),
    "half": (NET[: len(NET) // 2], "well-formed"),
    "empty": (b"", "well-formed"),
    "another root": (b"<osm/>", "expected the root element <net>, got <osm>"),
    "net inside another": (b"<a>" + NET[NET.index(b"<net") :] + b"</a>", "expected the root element <net>, got <a>"),
    "include": (b'<net><include href="/etc/passwd"/></net>', "element <include>"),
    "include beside the file": (b'<net><edge id="a"><include href="secret.xml"/></edge></net>', "element <include>"),
    "include in a namespace": (b'<net xmlns:i="urn:i"><i:include href="secret.xml"/></net>', "element <i:include>"),
    "include in UTF-16": (
        '<?xml version="1.0" encoding="UTF-16"?><net><include href="a"/></net>'.encode("utf-16"),
        "element <include>",
    ),
    "a light that writes": (
        b'<net><tlLogic id="a" type="actuated"><param key="file" value="/tmp/written.xml"/></tlLogic></net>',
        "parameter 'file'",
    ),
    "a detector that writes": (
        b'<net><inductionLoop id="a" lane="w_e_0" pos="1" period="1" file="/tmp/written.xml"/></net>',
        "element <inductionLoop>",
    ),
    "no lane": (NO_LANES, "no lane open to passenger cars"),
}


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_file_is_one_error_and_leaves_nothing(
    name: str, packed: bool, tmp_path: Path, homes: Callable[[], list[Path]]
) -> None:
    content, message = HOSTILE[name]
    path = tmp_path / ("town.net.xml.gz" if packed else "town.net.xml")
    path.write_bytes(gzip.compress(content) if packed else content)
    with pytest.raises(InvalidInputError, match=message) as caught:
        load_network(str(path))
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert homes() == []


@pytest.mark.parametrize("lost", [1, 4, 8, 9, 100])
def test_a_gzip_that_lacks_its_end_is_refused(lost: int, tmp_path: Path, homes: Callable[[], list[Path]]) -> None:
    path = tmp_path / "town.net.xml.gz"
    path.write_bytes(gzip.compress(NET)[:-lost])
    with pytest.raises(InvalidInputError, match="no complete gzip file"):
        load_network(str(path))
    assert homes() == []


def test_a_small_gzip_of_more_than_200_mb_is_refused(tmp_path: Path, homes: Callable[[], list[Path]]) -> None:
    path = tmp_path / "town.net.xml.gz"
    with gzip.open(path, "wb", compresslevel=1) as file:
        file.write(b"<net>")
        for _ in range(201):
            file.write(b" " * 1_000_000)
        file.write(b"</net>")
    assert path.stat().st_size < 2_000_000
    with pytest.raises(InvalidInputError, match="larger unpacked than 200 MB"):
        load_network(str(path))
    assert homes() == []


def test_a_file_of_more_than_200_mb_is_not_even_opened(tmp_path: Path, homes: Callable[[], list[Path]]) -> None:
    path = tmp_path / "town.net.xml"
    with path.open("wb") as file:
        file.truncate(200_000_001)  # a hole: it takes no room on the disk
    path.chmod(0)
    with pytest.raises(InvalidInputError, match="larger than 200 MB"):
        load_network(str(path))
    assert homes() == []


def test_the_limit_is_for_files_and_not_for_what_was_imported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "town.net.xml"
    path.write_bytes(NET)
    monkeypatch.setattr(catalog, "LIMIT_MB", 0.001)
    with pytest.raises(InvalidInputError, match=r"larger than 0.001 MB"):
        load_network(str(path))
    assert load_network("town-test").lanes.drivable.any()


@pytest.mark.parametrize("make", [Path.mkdir, os.mkfifo])
def test_what_is_no_file_is_not_waited_for(make: Callable[[Path], None], tmp_path: Path) -> None:
    path = tmp_path / "town.net.xml"
    make(path)
    with pytest.raises(InvalidInputError, match="it is not a file"):
        load_network(str(path))


@pytest.mark.parametrize("name", ["../town", "a/../../b", "/etc/passwd", "..", "town\x00", "catalog/../ingolstadt"])
def test_a_name_that_is_no_file_of_roads_leads_nowhere(name: str) -> None:
    with pytest.raises(InvalidInputError, match="no network named"):
        load_network(name)


def test_a_net_without_a_route_is_read_and_its_missions_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "road.net.xml"
    path.write_bytes(NET)
    network = load_network(str(path))
    backwards = Mission(start=Place(lane="w_e_0", position_m=50.0), goal=Place(lane="w_e_0", position_m=10.0))
    with pytest.raises(InvalidInputError, match="mission 'ego': no lane-level route leads from 'w_e_0'"):
        plan_route(network, backwards)


def test_the_census_counts_and_the_copy_is_plain(tmp_path: Path) -> None:
    path, copy = tmp_path / "town.net.xml.gz", tmp_path / "plain.xml"
    path.write_bytes(gzip.compress(NET))
    census = scan(path, "net", copy=copy)
    assert copy.read_bytes() == NET
    assert census.elements["lane"] == NET.count(b"<lane ")
    assert census.elements["net"] == 1
