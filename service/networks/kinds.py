"""Jobs of this room: the import of an uploaded road file."""

from __future__ import annotations

from typing import Final

from dohyo.service.confinement.limits import MEGABYTE
from dohyo.service.jobs.kind import Kind, Made, Task
from dohyo.service.networks import claims
from dohyo.service.networks.finding import view_network
from dohyo.service.networks.importing import LIMITS, import_confined
from dohyo.sumo_networks.networks.conversion.source_file import ImportOptions
from dohyo.sumo_networks.networks.entries import network_folder, network_names


def import_roads(task: Task) -> Made:
    """Adds an uploaded network to the catalog and notes its owner.

    Raises:
        ConflictError: A network of this name exists, or another job imports one.
        TooManyRequestsError: The owner, or the service, has as many networks as there may be.
    """
    name, database = str(task.arguments["name"]), task.services.database
    most = task.services.settings.networks_per_owner
    with database.session() as session:
        claimed = claims.claim_name(session, name, task.owner, task.id, most)
    # A network under a claim of this job was published by an earlier start of it.
    if not (claimed and name in network_names()):
        try:
            _convert(task, name)
        except BaseException:
            if name not in network_names():
                with database.session() as session:
                    claims.release(session, name, task.id)
            raise
    with database.session() as session:
        size = sum(one.stat().st_size for one in network_folder(name).iterdir())
        claims.complete(session, name, task.id, size)
    return Made(view_network(name).model_dump(mode="json"), f"/v1/networks/{name}")


def _convert(task: Task, name: str) -> None:
    given, file = task.arguments, task.file.with_name(f"{name}{task.arguments['suffix']}")
    if not file.exists():
        task.file.rename(file)
    limit_mb = task.services.settings.upload_limit_bytes * 4 / MEGABYTE
    import_confined(file, name, ImportOptions(**given["options"], limit_mb=limit_mb), stopped=task.stop.is_set)


IMPORT: Final = Kind("network_import", import_roads, limit_s=LIMITS.wall_s + 60.0)
