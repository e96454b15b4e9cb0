"""All kinds of jobs, by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from dohyo.service.jobs.kind import Kind
from dohyo.service.submissions import kinds as submissions

KINDS: Final[Mapping[str, Kind]] = {kind.name: kind for kind in (submissions.BUILTIN, submissions.ONNX)}
