"""Jobs of this room: the import of an uploaded road file."""

from __future__ import annotations

from typing import Final

from dohyo.service.confinement.limits import MEGABYTE
from dohyo.service.errors import ConflictError
from dohyo.service.jobs.kind import Kind, Made, Task
from dohyo.service.networks.finding import check_free, find_network, view_network
from dohyo.service.networks.importing import LIMITS, import_confined
from dohyo.service.networks.model import UploadedNetwork
from dohyo.sumo_networks.networks.entries import network_folder, network_names


def import_roads(task: Task) -> Made:
    """Adds an uploaded network to the catalog and notes its owner.

    Raises:
        ConflictError: A network of this name exists.
    """
    given, name = task.arguments, str(task.arguments["name"])
    services, file = task.services, task.file.with_name(f"{name}{given['suffix']}")
    with services.database.reading() as session:
        owned = session.get(UploadedNetwork, name) is not None
    # A network without an owner was published by an earlier start of this job, since the order was refused otherwise.
    if owned or name not in network_names():
        check_free(name)
        if not file.exists():
            task.file.rename(file)
        limit_mb = services.settings.upload_limit_bytes * 4 / MEGABYTE
        import_confined(
            file,
            name,
            lights=given["lights"],
            limit_mb=limit_mb,
            licence=given["licence"],
            stopped=task.stop.is_set,
        )
    size = sum(one.stat().st_size for one in network_folder(name).iterdir())
    with services.database.session() as session:
        if session.get(UploadedNetwork, name) is not None:
            raise ConflictError(f"network '{name}' exists, and networks never change; choose another name")
        session.add(UploadedNetwork(name=name, owner=task.owner, kept_bytes=size))
    return Made(view_network(find_network(name)).model_dump(mode="json"), f"/v1/networks/{name}")


IMPORT: Final = Kind("network_import", import_roads, limit_s=LIMITS.wall_s + 60.0)
