"""GHRL drives the same with the kernels of another processor, so that a record's hash verifies on another machine."""

from __future__ import annotations

import pytest

from tests.agents.old_processor import printed_here_and_there

PROGRAM = """
import hashlib
from dohyo.agents.hierarchical.ghrl import Ghrl
from tests.agents.driving import drive
from tests.worlds import lit_crossing, straight_road

scenes = (straight_road().with_ego(x=50.0, speed=5.0).with_actor(110.0, 3.0), lit_crossing().with_ego(x=-90.0))
for arm in ("ghrl", "ghrl-s", "ghrl-r"):
    for scene in scenes:
        told = b"".join(world.egos.position.tobytes() for world in drive(Ghrl(arm), scene, 6.0))
        print(arm, hashlib.sha256(told).hexdigest())
"""


@pytest.mark.slow
def test_it_drives_the_same_with_the_kernels_of_an_old_processor() -> None:
    here, old = printed_here_and_there(PROGRAM)
    assert len(here) == 6
    assert here == old
