"""Import of an uploaded road file: converted and checked in a confined process, published by the service."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Final

from dohyo.service.confinement.folders import private_folder
from dohyo.service.confinement.limits import Limits
from dohyo.service.confinement.runner import run
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import write_atomically
from dohyo.sumo_networks.networks.conversion.source_file import ImportOptions
from dohyo.sumo_networks.networks.importing import net_name, prepare_network, publish_network
from dohyo.sumo_networks.networks.network import cache_folder, parsed_name
from dohyo.sumo_networks.networks.parsing import file_hash

LIMITS: Final = Limits(wall_s=300.0, cpu_s=280, memory_mb=4000, file_mb=1000, folder_mb=2500, processes=4)


def import_confined(
    file: Path,
    name: str,
    options: ImportOptions,
    *,
    stopped: Callable[[], bool] = lambda: False,
) -> None:
    """Adds an uploaded network to the catalog; blocks, so call it from a thread.

    Args:
        file: The uploaded file.
        name: Name of the new network.
        options: Choices of the import; the confined process has its own time limit.
        stopped: Asked now and then; once true, the import is ended.

    Raises:
        InvalidInputError: The file is refused, with the reason.
        BusyError: Too many imports are running.
        StorageFullError: The disk is full.
    """
    # The runner ends netconvert before this limit.
    options = replace(options, timeout_s=10 * LIMITS.wall_s)
    arguments = {"file": str(file), "name": name, "options": asdict(options)}
    with private_folder() as folder:
        environment = {"DOHYO_CACHE": str(folder / "cache")}
        try:
            run(
                "import_roads",
                arguments,
                LIMITS,
                folder=folder,
                reads=[file],
                environment=environment,
                stopped=stopped,
            )
        except InvalidInputError as error:
            raise InvalidInputError(str(error).replace(str(file), file.name)) from error
        _keep_parsed(publish_network(name, folder / "entry") / net_name(name), folder / "cache")


def _keep_parsed(net: Path, cache: Path) -> None:
    """Keeps the arrays of the parsed net, so that no other process need parse a stranger's file."""
    parsed = parsed_name(file_hash(net))
    made, kept = cache / parsed, cache_folder() / parsed
    if made.is_file() and not made.is_symlink():
        kept.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(kept, made.read_bytes())


def prepare(arguments: Mapping[str, Any]) -> None:
    """Converts and checks a file in the private folder, which is the working directory of the confined process."""
    entry = Path.cwd() / "entry"
    entry.mkdir()
    options = ImportOptions(**arguments["options"])
    prepare_network(Path(arguments["file"]), arguments["name"], entry, options)
