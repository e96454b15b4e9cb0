"""Signal programs: what an import changes in those of a net is said, and NEMA programs are kept."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.conversion.programs import SignalProgram, describe_changes, read_programs
from dohyo.sumo_networks.networks.conversion.source_file import ImportOptions
from dohyo.sumo_networks.networks.importing import import_network
from tests.sumo_networks.networks.test_importing import given, netconvert

ARMS = (("w", -200, 0), ("e", 200, 0), ("n", 0, 200), ("s", 0, -200))


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DOHYO_HOME", str(tmp_path / "home"))


def lit_net(folder: Path, kind: str) -> Path:
    """A crossroads with one light and no crossings."""
    nodes = '<node id="c" x="0" y="0" type="traffic_light"/>'
    nodes += "".join(f'<node id="{arm}" x="{x}" y="{y}"/>' for arm, x, y in ARMS)
    edges = "".join(
        f'<edge id="{a}{b}" from="{a}" to="{b}" numLanes="2"/>'
        for arm, _, _ in ARMS
        for a, b in ((arm, "c"), ("c", arm))
    )
    plain = given(folder, "x.nod.xml", f"<nodes>{nodes}</nodes>"), given(folder, "x.edg.xml", f"<edges>{edges}</edges>")
    net = folder / "lit.net.xml"
    netconvert("-n", str(plain[0]), "-e", str(plain[1]), "-o", str(net), "--tls.default-type", kind)
    return net


def changes(guessed: tuple[str, ...]) -> list[str]:
    return [line for line in guessed if "signal programs of the file" in line]


def test_an_import_says_how_crossings_change_the_programs_of_a_net(tmp_path: Path) -> None:
    net = lit_net(tmp_path, "actuated")
    text = net.read_text()
    net.write_text(text.replace('minDur="5"', 'minDur="5.00" name="main" next="1"', 1))
    (line,) = changes(import_network(net, "lit").report.guessed)
    assert line == (
        "1 of 1 signal programs of the file are changed: 1 with signals for crossings, 1 with more phases, "
        "1 with a longer shortest green, 1 with another order of phases ('next'), 1 without the names of phases"
    )


def test_programs_that_stay_are_not_mentioned(tmp_path: Path) -> None:
    net = lit_net(tmp_path, "static")
    walked = tmp_path / "walked.net.xml"
    netconvert("-s", str(net), "--sidewalks.guess", "--crossings.guess", "-o", str(walked))
    text = walked.read_text()
    walked.write_text(text.replace('duration="5"', 'duration="5.00"'))
    assert changes(import_network(walked, "walked").report.guessed) == []
    assert describe_changes(read_programs(walked), read_programs(walked)) == []
    assert changes(import_network(walked, "again", ImportOptions(lights=True)).report.guessed) == []
    walked.write_text(text.replace('duration="5"', 'duration="0:0:5"'))
    assert changes(import_network(walked, "clock").report.guessed) == []
    assert {program.cycle_s for program in read_programs(walked).values()} == {
        sum(map(float, re.findall(r'<phase duration="(\d+)"', text)))
    }


def test_the_shortest_green_of_a_link_goes_over_phases_and_the_end_of_the_cycle() -> None:
    phases = ({"state": "Gr", "duration": "7", "minDur": "3"}, {"state": "rG", "duration": "9"})
    program = SignalProgram("actuated", "0", (*phases, {"state": "gr", "duration": "4"}), {})
    assert (program.shortest_green_s(0), program.shortest_green_s(1)) == (7.0, 9.0)
    longer = SignalProgram("actuated", "0", (*phases, {"state": "gr", "duration": "5"}), {})
    (line,) = describe_changes({("a", "0"): program}, {("a", "0"): longer})
    assert line.endswith("are changed: 1 with a longer cycle, 1 with a longer shortest green")
    assert describe_changes({("a", "0"): program}, {}) == ["1 of 1 signal programs of the file are left out"]


def test_nema_programs_are_kept_and_no_crossings_guessed(tmp_path: Path) -> None:
    net = lit_net(tmp_path, "NEMA")
    report = import_network(net, "nema").report
    assert "no crossings are guessed, since they would break 1 NEMA signal programs" in report.guessed
    assert (report.lights, report.crossings) == (1, 0)
    assert changes(report.guessed) == []


def test_an_error_says_which_net_sumo_cannot_open_and_why(tmp_path: Path) -> None:
    net, broken = lit_net(tmp_path, "NEMA"), tmp_path / "broken.net.xml"
    netconvert("-s", str(net), "--sidewalks.guess", "--crossings.guess", "-o", str(broken))
    with pytest.raises(InvalidInputError, match=r"broken.net.xml': SUMO cannot open it: .*no phase named"):
        import_network(broken, "broken")
    net.write_text(net.read_text().replace('name="2"', 'name="9"'))
    with pytest.raises(InvalidInputError, match=r"SUMO cannot open the net that netconvert made of it: .*no phase"):
        import_network(net, "wrong")
