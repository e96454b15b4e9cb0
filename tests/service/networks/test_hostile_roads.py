"""Road files that attack the service, uploaded to it: refused, and nothing is read, written or left."""

from __future__ import annotations

import gzip
import os
import tempfile
from pathlib import Path
from typing import Any

import pytest

from dohyo.service.confinement.folders import PREFIX
from tests.service.harness import Harness, assert_problem
from tests.service.networks.test_networks import PLAIN, upload

TARGET = "/tmp/dohyo-written-by-sumo.xml"
INCLUDE = PLAIN.replace(b"<edge ", b'<include href="%s"/><edge ', 1)
DETECTOR = PLAIN.replace(
    b"</net>", f'<inductionLoop id="d" lane="a_0" pos="1" period="1" file="{TARGET}"/></net>'.encode(), 1
)
LIGHT = PLAIN.replace(
    b"</net>",
    f'<tlLogic id="t" type="actuated" programID="0" offset="0"><param key="file" value="{TARGET}"/></tlLogic>'
    "</net>".encode(),
    1,
)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (INCLUDE.replace(b"%s", b"/etc/passwd"), "<include>"),
        (INCLUDE.replace(b"%s", b"../../dohyo.db"), "<include>"),
        (INCLUDE.replace(b"%s", b"http://127.0.0.1:9/net.xml"), "<include>"),
        (DETECTOR, "<inductionLoop>"),
        (LIGHT, "parameter 'file'"),
        (b'<!DOCTYPE net [<!ENTITY a SYSTEM "file:///etc/passwd">]>' + PLAIN, "DOCTYPE"),
        (b"<net>" + b" " * 220_000_000 + b"</net>", "larger unpacked than 200 MB"),
    ],
    ids=["include", "relative include", "remote include", "detector", "light", "entity", "bomb"],
)
def test_a_file_that_names_other_files_is_refused(service: Harness, content: bytes, says: str) -> None:
    answer: Any = upload(service.caller("team"), gzip.compress(content, 1), "town.net.xml.gz")
    assert_problem(answer, 422, says)
    assert "root:" not in answer.text
    assert not Path(TARGET).exists()
    assert list(Path(tempfile.gettempdir()).glob(f"{PREFIX}{os.getpid()}-*")) == []
    assert not list(service.services.settings.data.glob("networks/*"))
