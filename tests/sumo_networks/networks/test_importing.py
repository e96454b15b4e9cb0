"""Import: every format in, everything hostile out, and nothing written unless all went well."""

from __future__ import annotations

import bz2
import gzip
import json
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import sumo
from typer.testing import CliRunner

from dohyo.service.cli import app
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.networks import importing
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.networks.conversion.source_file import ImportOptions
from dohyo.sumo_networks.networks.entries import CATALOG, network_entry, network_names, network_path
from dohyo.sumo_networks.networks.importing import Imported, import_network
from dohyo.sumo_networks.networks.inspection import inspect_network
from dohyo.sumo_networks.routes.routing import plan_route
from dohyo.sumo_networks.scenario import Mission, Place
from tests.extracts import as_pbf, crossroads
from tests.forked import Python

TOWN = CATALOG / "town-test" / "town-test.net.xml"

OSM = crossroads()

BARE = """<net version="1.20" xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance">
 <location netOffset="0.00,0.00" convBoundary="0,0,100,0" origBoundary="0,0,100,0" projParameter="!"/>
 {edges}
 <junction id="a" type="dead_end" x="0" y="0" incLanes="" intLanes="" shape="0,0 0,-3"/>
 <junction id="b" type="dead_end" x="100" y="0" incLanes="{inc}" intLanes="" shape="100,-3 100,0"/>
</net>
"""
LANE = (
    '<edge id="e" from="a" to="b" priority="1">'
    '<lane id="e_0" index="0" speed="13.89" length="100" {allow} shape="0,-1.6 100,-1.6"/></edge>'
)
BOMB = '<!DOCTYPE {root} [<!ENTITY a "aaaaaaaa"><!ENTITY b "&a;&a;&a;&a;">]><{root}>&b;</{root}>'


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("DOHYO_HOME", str(tmp_path / "home"))
    return tmp_path / "home"


def written(home: Path) -> list[Path]:
    return [path for path in home.rglob("*") if path.is_file()]


def netconvert(*arguments: str) -> None:
    command = [str(Path(sumo.SUMO_HOME) / "bin" / "netconvert"), *arguments]
    subprocess.run(command, check=True, capture_output=True)


def given(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


# Formats


@pytest.fixture
def osm(tmp_path: Path) -> Path:
    return given(tmp_path, "crossroads.osm", OSM)


def test_a_net_with_crossings_is_taken_as_it_is(home: Path) -> None:
    done = import_network(TOWN, "copy")
    network, original = load_network("copy"), load_network("town-test")
    assert "copy" in network_names()
    assert network_path("copy").parent == done.folder == home / "networks" / "copy"
    np.testing.assert_array_equal(network.lanes.points, original.lanes.points)
    np.testing.assert_array_equal(network.lanes.ids, original.lanes.ids)
    assert done.report.guessed == ()


def test_a_net_without_sidewalks_gets_them_and_says_so(tmp_path: Path) -> None:
    bare = tmp_path / "bare.net.xml"
    netconvert(
        "-s", str(TOWN), "--remove-edges.by-vclass", "pedestrian", "-o", str(bare), "--no-internal-links", "true"
    )
    source = (CATALOG / "town-test" / "town-test.edg.xml", CATALOG / "town-test" / "town-test.nod.xml")
    netconvert("-e", str(source[0]), "-n", str(source[1]), "-o", str(bare))
    done = import_network(bare, "guessed")
    assert done.report.crossings > 8
    assert done.report.sidewalk_share > 0.9
    assert any("sidewalks added" in line for line in done.report.guessed)
    assert network_entry("guessed").guessed == done.report.guessed


@pytest.mark.parametrize(
    ("name", "write"),
    [
        ("crossroads.osm", lambda path: None),
        ("crossroads.osm.xml.gz", lambda path: path.write_bytes(gzip.compress(OSM.encode()))),
        ("Crossroads.OSM.BZ2", lambda path: path.write_bytes(bz2.compress(OSM.encode()))),
        ("crossroads.osm.pbf", lambda path: as_pbf(path.with_name("crossroads.osm"))),
    ],
)
def test_openstreetmap(osm: Path, name: str, write: Callable[[Path], None]) -> None:
    osm = osm.with_name(name)
    write(osm)
    report = import_network(osm, "crossroads").report
    assert report.lanes >= 10
    assert report.road_km == pytest.approx(2 * 0.17 * (1 + 1), rel=0.15)
    assert report.lights == 0
    assert "ODbL" in network_entry("crossroads").licence


def test_a_node_without_a_place_does_not_hide_the_country_of_the_others(osm: Path) -> None:
    osm.write_text(OSM.replace("<way", '<node id="99" lat="nan" lon="13" version="1"/><way', 1))
    assert import_network(osm, "crossroads").report.guessed[0].startswith("country DE")


def test_lights_are_guessed_on_request(osm: Path) -> None:
    assert import_network(osm, "lit", ImportOptions(lights=True)).report.lights == 1


def test_opendrive(tmp_path: Path) -> None:
    netconvert("-s", str(TOWN), "--opendrive-output", str(tmp_path / "town.xodr"))
    report = import_network(tmp_path / "town.xodr", "xodr-town").report
    original = inspect_network(load_network("town-test"))
    assert report.lanes == original.lanes
    assert report.road_km == pytest.approx(original.road_km, rel=0.05)
    assert report.connected_share == 1.0


def test_the_same_file_gives_the_same_network(osm: Path) -> None:
    first, second = (import_network(osm, name).report.sha256 for name in ("one", "two"))
    assert first == second
    assert import_network(osm, "one", force=True).report.sha256 == first


def test_an_imported_network_can_be_driven(osm: Path) -> None:
    import_network(osm, "crossroads")
    network = load_network("crossroads")
    ends = [str(i) for i in network.lanes.ids[network.lanes.drivable & ~network.lanes.internal]]
    routes = 0
    for start in ends:
        for goal in ends:
            try:
                routes += plan_route(network, Mission(start=Place(lane=start), goal=Place(lane=goal))).length > 100
            except InvalidInputError:
                continue
    assert routes > 10


def test_a_killed_import_leaves_nothing(tmp_path: Path, osm: Path, home: Path) -> None:
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    code = "import sys, tempfile; tempfile.tempdir = sys.argv.pop(1); from dohyo.service.cli import main; main()"
    for number in range(5):  # on a busy machine an import may end before it is killed
        before = written(home)
        process = Python(code, str(temporary), "networks", "import", str(osm), "--name", f"killed-{number}")
        while process.poll() is None and not any(temporary.glob("dohyo-import-*/*")):
            time.sleep(0.01)
        if (ended := process.end(signal.SIGTERM)) == 130:
            break
    assert ended == 130
    assert list(temporary.iterdir()) == []
    assert written(home) == before


# Names


@pytest.mark.parametrize(
    "name",
    [
        "",
        ".",
        "..",
        "../x",
        "a/b",
        "/etc/x",
        "a\\b",
        "A",
        "-a",
        "a_b",
        "a.b",
        "a" * 64,
        "ä",
        "a\n",
        "con\x00",
        " a",
        "~",
    ],
)
def test_no_name_leaves_the_catalog(home: Path, name: str) -> None:
    with pytest.raises(InvalidInputError, match="network name"):
        import_network(TOWN, name)
    assert not home.exists()
    with pytest.raises(InvalidInputError):
        load_network(name)


def test_names_that_come_with_dohyo_are_taken(home: Path) -> None:
    with pytest.raises(InvalidInputError, match="comes with dohyo"):
        import_network(TOWN, "ingolstadt", force=True)
    assert not home.exists()


def test_a_folder_put_there_by_hand_does_not_hide_ours(home: Path) -> None:
    (home / "networks" / "ingolstadt").mkdir(parents=True)
    (home / "networks" / "ingolstadt" / "network.toml").write_text('title = "x"\nsource = "x"\nlicence = "x"\n')
    assert "game/fkk_in" in str(network_path("ingolstadt"))


def test_a_name_in_use_needs_force(osm: Path) -> None:
    import_network(osm, "here")
    with pytest.raises(InvalidInputError, match="--force"):
        import_network(TOWN, "here")
    assert load_network("here").signals.light_ids.size == 0
    import_network(TOWN, "here", force=True)
    assert load_network("here").signals.light_ids.size == 8
    assert [path.name for path in network_path("here").parent.parent.iterdir()] == ["here"]


def test_the_data_folder_follows_xdg(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DOHYO_HOME")
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "xdg"))
    assert import_network(TOWN, "there").folder == tmp_path / "xdg" / "dohyo" / "networks" / "there"


def test_unknown_names_are_told_with_a_hint(osm: Path) -> None:
    import_network(osm, "crossroads")
    with pytest.raises(UnknownNameError, match="did you mean 'crossroads'"):
        load_network("crosroads")


# Bad input

BAD = {
    "empty.net.xml": ("", "well-formed"),
    "half.net.xml": ("<net><edge", "well-formed"),
    "noise.osm": ("\x01\x02 no xml", "well-formed"),
    "other.net.xml": (OSM, "root element <net>, got <osm>"),
    "other.osm": ("<net/>", "root element <osm>"),
    "void.osm": ("<osm/>", "netconvert cannot use the file"),
    "void.xodr": ("<OpenDRIVE/>", "netconvert cannot use the file"),
    "lanes.net.xml": (BARE.format(edges="", inc=""), "no lane open to passenger cars"),
    "footpath.net.xml": (BARE.format(edges=LANE.format(allow='allow="pedestrian"'), inc="e_0"), "passenger cars"),
    "road.net.xml": (BARE.format(edges=LANE.format(allow=""), inc="e_0"), "no road leads to another"),
    "bomb.net.xml": (BOMB.format(root="net"), "DOCTYPE"),
    "bomb.osm": (BOMB.format(root="osm"), "DOCTYPE"),
    "bomb.xodr": (BOMB.format(root="OpenDRIVE"), "DOCTYPE"),
    "external.osm": ('<!DOCTYPE osm [<!ENTITY x SYSTEM "file:///etc/passwd">]><osm>&x;</osm>', "DOCTYPE"),
    "dtd.osm": ('<!DOCTYPE osm SYSTEM "http://127.0.0.1:9/x.dtd"><osm/>', "DOCTYPE"),
    "undefined.osm": ("<osm>&x;</osm>", "well-formed"),
    "road.txt": (OSM, "expected a file that ends in"),
}


@pytest.mark.parametrize("name", BAD)
@pytest.mark.parametrize("packed", [False, True])
def test_bad_input_is_one_error_and_nothing_is_written(tmp_path: Path, home: Path, name: str, packed: bool) -> None:
    text, message = BAD[name]
    path = given(tmp_path, name, text)
    if packed:
        path = tmp_path / f"{name}.gz"
        path.write_bytes(gzip.compress(text.encode()))
    with pytest.raises(InvalidInputError, match=message) as caught:
        import_network(path, "bad")
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)
    assert written(home) == []
    assert "bad" not in network_names()


def test_a_doctype_in_another_encoding_is_refused_too(tmp_path: Path, home: Path) -> None:
    path = tmp_path / "bomb.osm"
    path.write_bytes(('<?xml version="1.0" encoding="UTF-16"?>' + BOMB.format(root="osm")).encode("utf-16"))
    with pytest.raises(InvalidInputError, match="DOCTYPE"):
        import_network(path, "bad")
    assert written(home) == []


@pytest.mark.parametrize("keep", [0, 5, 200, -8, -1])
def test_a_truncated_gzip(tmp_path: Path, home: Path, keep: int) -> None:
    path = tmp_path / "town.net.xml.gz"
    path.write_bytes(gzip.compress(TOWN.read_bytes())[:keep])
    with pytest.raises(InvalidInputError, match=r"gzip|well-formed"):
        import_network(path, "bad")
    assert written(home) == []


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("town.net.xml.gz", "no complete gzip"),
        ("town.net.xml.bz2", "no complete bzip2"),
        ("town.osm.pbf", "no complete .pbf"),
    ],
)
def test_text_that_calls_itself_packed(tmp_path: Path, name: str, message: str) -> None:
    if name.endswith(".pbf"):
        pytest.importorskip("osmium")
    with pytest.raises(InvalidInputError, match=message):
        import_network(given(tmp_path, name, "<net/>"), "bad")


def test_the_size_limit_holds_packed_and_unpacked(tmp_path: Path, home: Path) -> None:
    blank = b"<osm>" + b" " * 3_000_000 + b"</osm>"
    large, packed = tmp_path / "large.osm", tmp_path / "packed.osm.gz"
    large.write_bytes(blank)
    packed.write_bytes(gzip.compress(blank))
    assert packed.stat().st_size < 10_000
    for path in (large, packed):
        with pytest.raises(InvalidInputError, match=r"larger.* than 2 MB; an import may allow more with --limit-mb"):
            import_network(path, "bad", ImportOptions(limit_mb=2))
    assert written(home) == []


def test_a_pbf_that_unpacks_to_more_than_the_limit_is_refused_before_it_is_written(tmp_path: Path, home: Path) -> None:
    osmium = pytest.importorskip("osmium")
    packed = tmp_path / "bomb.osm.pbf"
    with osmium.SimpleWriter(str(packed), overwrite=True) as writer:
        writer.add_node(osmium.osm.mutable.Node(id=1, location=(13.0, 52.0), version=1))
        for way in range(100):
            writer.add_way(osmium.osm.mutable.Way(id=way + 1, nodes=[1] * 2000, tags={"highway": "service"}, version=1))
    assert packed.stat().st_size < 100_000
    with pytest.raises(InvalidInputError, match=r"unpacked than 1 MB"):
        import_network(packed, "bad", ImportOptions(limit_mb=1))
    assert written(home) == []


def test_a_name_and_a_licence_beyond_16_bits_can_be_read_again(osm: Path) -> None:
    """TOML has no pairs of halves for a character, as JSON has; before, the published network was broken."""
    osm = osm.rename(osm.with_name("kreuzung \U0001f600 é.osm"))
    import_network(osm, "crossroads", ImportOptions(licence="\U00020000 \\ud83d"))
    entry = network_entry("crossroads")
    assert (entry.source, entry.licence) == (osm.name, "\U00020000 \\ud83d")


def test_an_interrupted_replacement_leaves_the_network_that_was_there(
    osm: Path, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import_network(osm, "crossroads")
    there = written(home)

    def interrupted(source: Path, target: Path) -> None:
        monkeypatch.undo()
        raise KeyboardInterrupt

    monkeypatch.setattr(importing.os, "rename", interrupted)
    with pytest.raises(KeyboardInterrupt):
        import_network(osm, "crossroads", force=True)
    assert written(home) == there


def test_files_that_are_not_there(tmp_path: Path) -> None:
    for path in (tmp_path / "missing.osm", tmp_path / "folder.osm"):
        (tmp_path / "folder.osm").mkdir(exist_ok=True)
        with pytest.raises(InvalidInputError, match="cannot read"):
            import_network(path, "bad")


def test_netconvert_is_stopped_when_it_takes_too_long(osm: Path, home: Path) -> None:
    with pytest.raises(InvalidInputError, match="did not finish within"):
        import_network(osm, "bad", ImportOptions(timeout_s=0.001))
    assert written(home) == []


def test_a_failed_replacement_leaves_the_old_network(osm: Path, tmp_path: Path) -> None:
    before = import_network(osm, "kept").report.sha256
    with pytest.raises(InvalidInputError):
        import_network(given(tmp_path, "bad.osm", "<osm"), "kept", force=True)
    assert load_network("kept").sha256 == before


def test_a_catalog_that_cannot_be_written_is_one_error(home: Path) -> None:
    home.write_text("a file in the place of the folder")
    with pytest.raises(InvalidInputError, match=r"cannot write '.*/mine': "):
        import_network(TOWN, "mine")


# The command line


def dohyo(*arguments: object) -> tuple[int, str, BaseException | None]:
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    return result.exit_code, result.output, result.exception


def test_the_commands(osm: Path, tmp_path: Path) -> None:
    code, output, _ = dohyo("networks", "import", osm, "--name", "crossroads", "--lights")
    assert code == 0
    assert "every lane leads to every other" in output
    _, output, _ = dohyo("networks", "check", "crossroads", "--json")
    report = json.loads(output)
    assert report["lights"] == 1
    assert report["dead_ends"]
    _, output, _ = dohyo("networks", "list", "--json")
    rows = {row["name"]: row for row in json.loads(output)}
    assert rows["crossroads"]["from"] == "you"
    assert rows["ingolstadt"]["from"] == "dohyo"
    code, _, error = dohyo("networks", "import", osm, "--name", "../crossroads")
    assert code != 0
    assert isinstance(error, InvalidInputError)


def test_a_broken_import_does_not_hide_the_other_networks(home: Path) -> None:
    folder = import_network(TOWN, "broken").folder
    next(folder.glob("*.gz")).write_bytes(b"")
    code, output, _ = dohyo("networks", "list", "--json")
    assert code == 0
    (row,) = [row for row in json.loads(output) if row["name"] == "broken"]
    assert row["title"].startswith("broken: ")


def test_an_import_says_where_it_is(osm: Path) -> None:
    done = import_network(osm, "crossroads")
    assert isinstance(done, Imported)
    assert sorted(path.name for path in done.folder.iterdir()) == ["crossroads.net.xml.gz", "network.toml"]
