"""All kinds of jobs, by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from dohyo.service.jobs.kind import Kind

ALL: Final[tuple[Kind, ...]] = ()
KINDS: Final[Mapping[str, Kind]] = {kind.name: kind for kind in ALL}
