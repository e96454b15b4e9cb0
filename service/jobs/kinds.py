"""All kinds of jobs, by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from dohyo.service.episodes import kinds as episodes
from dohyo.service.jobs.kind import Kind
from dohyo.service.networks import kinds as networks
from dohyo.service.submissions import kinds as submissions

ALL: Final = (submissions.BUILTIN, submissions.ONNX, networks.IMPORT, episodes.REDRIVE)
KINDS: Final[Mapping[str, Kind]] = {kind.name: kind for kind in ALL}
