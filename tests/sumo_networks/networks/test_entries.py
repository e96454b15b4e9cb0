"""Entries of the catalogs: read again when they change, and found by names alone."""

from __future__ import annotations

from pathlib import Path

import pytest

from dohyo.sumo_networks.errors import UnknownNameError
from dohyo.sumo_networks.networks.entries import network_entry, network_path

ENTRY = 'title = "{title}"\nsource = "us"\nlicence = "EPL-2.0"\nfile = "{file}"\n'


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("DOHYO_HOME", str(tmp_path))
    return tmp_path


def write(folder: Path, **facts: str) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "network.toml").write_text(ENTRY.format(**facts))


def test_an_entry_is_read_again_once_its_file_has_changed(home: Path) -> None:
    folder = home / "networks" / "mine"
    write(folder, title="old", file="a.net.xml")
    assert (network_entry("mine").title, network_path("mine").name) == ("old", "a.net.xml")
    write(folder, title="newer", file="b.net.xml")
    assert (network_entry("mine").title, network_path("mine").name) == ("newer", "b.net.xml")


def test_an_entry_outside_the_catalog_has_no_name(home: Path) -> None:
    (home / "networks").mkdir()
    write(home / "secret", title="outside", file="a.net.xml")
    with pytest.raises(UnknownNameError, match="no network named"):
        network_entry("../secret")


def test_the_networks_that_come_with_dohyo_take_precedence(home: Path) -> None:
    write(home / "networks" / "district", title="other", file="a.net.xml")
    assert network_entry("district").title != "other"
