"""Mirroring: the image is the same in every spelling of XML."""

from __future__ import annotations

import re
from collections.abc import Callable

import pytest

from dohyo.sumo_networks.networks.conversion.mirroring import mirror_image

NET = """<net version="1.20" lefthand="true">
<location netOffset="0.00,0.00" convBoundary="-10.00,0.00,100.00,50.00" projParameter="+proj=utm +zone=30"/>
<edge id="e" from="a" to="b" shape="0.00,1.00 100.00,1.00"><param key="x" value="&lt;1&quot;"/>
<lane id="e_0" length="100.00" shape="0.00,1.60,3.00 100.00,1.60"/></edge>
<junction id="a" type="dead_end" x="-10.00" y="1.00" shape="0.00,0.00" customShape="true"/>
<connection from="e" to="f" dir="l"/><connection from="e" to="e" dir="T"/>
</net>"""
IMAGE = """<?xml version="1.0" encoding="UTF-8"?>
<net version="1.20">
<location netOffset="0.00,0.00" convBoundary="-10.00,0.00,100.00,50.00" projParameter="!"/>
<edge id="e" from="a" to="b" shape="90.00,1.00 -10.00,1.00"><param key="x" value='&lt;1"'/>
<lane id="e_0" length="100.00" shape="90.00,1.60,3.00 -10.00,1.60"/></edge>
<junction id="a" type="dead_end" x="100.00" y="1.00" shape="90.00,0.00" customShape="true"/>
<connection from="e" to="f" dir="r"/><connection from="e" to="e" dir="t"/>
</net>"""
SPELLINGS: dict[str, Callable[[str], bytes]] = {
    "sumo": lambda net: net.encode(),
    "single quotes": lambda net: net.replace('"', "'").encode(),
    "spaces": lambda net: re.sub(r'(\w+)="', r'\1 = "', net).encode(),
    "new lines": lambda net: re.sub(r' (\w+="|/>)', r"\n  \1", net).encode(),
    "UTF-16": lambda net: net.encode("utf-16"),
}


@pytest.mark.parametrize("spelling", SPELLINGS)
def test_the_image_is_the_same_in_every_spelling(spelling: str) -> None:
    assert mirror_image(SPELLINGS[spelling](NET)).decode() == IMAGE
