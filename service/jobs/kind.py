"""Kind: how jobs of one kind are done. Each room has its own; `dohyo.service.jobs.kinds` lists them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dohyo.service.state import Services


@dataclass(frozen=True, slots=True)
class Task:
    """A running job, as its kind sees it.

    Attributes:
        id: Identifier of the job.
        owner: Owner of the job, whose shares it uses.
        arguments: Plain JSON, as ordered.
        file: The uploaded file; only for kinds that take one.
        services: The services of the app.
        stop: Set when the job is cancelled, takes too long, or the service ends; the work should then end soon.
    """

    id: str
    owner: str
    arguments: Mapping[str, Any]
    file: Path
    services: Services
    stop: Event = field(default_factory=Event)


@dataclass(frozen=True, slots=True)
class Made:
    """Result of a job.

    Attributes:
        answer: The body that its order answers, plain JSON.
        result: Path of what it made, such as "/v1/networks/my-town"; None: nothing that can be read elsewhere.
    """

    answer: dict[str, Any]
    result: str | None = None


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of jobs.

    Attributes:
        name: Name in the database and in answers, such as "onnx_submission".
        run: Does the work, in a thread that may block; an error of it is the job's failure. Untrusted and long
            computations belong into child processes, so that other requests are served meanwhile.
        limit_s: Wall-clock limit of the work.
        repeatable: Whether a job that ran when the service died is queued again; if not, it has failed.
    """

    name: str
    run: Callable[[Task], Made]
    limit_s: float
    repeatable: bool = True
