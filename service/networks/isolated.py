"""Isolated work on untrusted input, in a child process with limits on time, memory and file size.

`python -m dohyo.service.networks.isolated TASK` reads one JSON object of arguments from standard input and prints one
JSON object: {"result": ...}, {"refused": "why"} or {"full": true}. The child can only run the tasks named here.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from threading import BoundedSemaphore
from typing import Any, Final

from dohyo.service.errors import DISK_FULL, BusyError, StorageFullError
from dohyo.sumo_networks.errors import DohyoError, InvalidInputError

AT_ONCE: Final = 2
MEMORY_BYTES: Final = 8_000_000_000  # address space, of which numpy and torch reserve more than they use
FILE_BYTES: Final = 2_000_000_000
WAIT_S: Final = 20.0

_slots = BoundedSemaphore(AT_ONCE)


def run_isolated(task: str, arguments: Mapping[str, Any], timeout_s: float) -> Any:
    """Runs a task in a child process; blocks, so call it from a thread.

    Args:
        task: A name in `TASKS`.
        arguments: Plain JSON.
        timeout_s: Time after which the child is ended.

    Raises:
        InvalidInputError: The task refused its input, did not end in time, or broke.
        BusyError: Too many are running.
        StorageFullError: The disk is full.
    """
    if not _slots.acquire(timeout=WAIT_S):
        raise BusyError("too many uploads are being checked", retry_s=WAIT_S)
    try:
        done = subprocess.run(
            [sys.executable, "-m", "dohyo.service.networks.isolated", task],
            input=json.dumps(arguments),
            capture_output=True,
            text=True,
            errors="replace",
            timeout=timeout_s,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        raise InvalidInputError(f"it took longer than {timeout_s:g} s to check") from error
    finally:
        _slots.release()
    try:
        answer = json.loads(done.stdout.splitlines()[-1])
    except (IndexError, ValueError) as error:
        raise InvalidInputError("it could not be checked: its process ended, perhaps for lack of memory") from error
    if "full" in answer:
        raise StorageFullError()
    if "refused" in answer:
        raise InvalidInputError(answer["refused"])
    return answer["result"]


def describe_agent(arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Builds a built-in agent with settings and returns its AgentInfo."""
    from dohyo.evaluation.agent import agent_info, make_agent

    entry, settings = arguments["entry"], arguments["settings"]
    agent = make_agent(entry, settings)
    try:
        return agent_info(agent, entry, settings, "builtin").model_dump(mode="json")
    finally:
        if hasattr(agent, "close"):
            agent.close()


def import_file(arguments: Mapping[str, Any]) -> None:
    """Imports a road network into the catalog."""
    from dohyo.sumo_networks.networks.importing import import_network

    import_network(
        Path(arguments["file"]),
        arguments["name"],
        lights=arguments["lights"],
        limit_mb=arguments["limit_mb"],
        licence=arguments["licence"],
        timeout_s=arguments["timeout_s"],
    )


TASKS: Final[Mapping[str, Callable[[Mapping[str, Any]], Any]]] = {
    "describe_agent": describe_agent,
    "import_file": import_file,
}


def main() -> None:
    """Entry point of the child process."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    resource.setrlimit(resource.RLIMIT_FSIZE, (FILE_BYTES, FILE_BYTES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    arguments = json.load(sys.stdin)
    try:
        answer = {"result": TASKS[sys.argv[1]](arguments)}
    except DohyoError as error:
        answer = {"full": True} if _disk_is_full(error) else {"refused": str(error)}
    except OSError as error:
        if not _disk_is_full(error):
            raise
        answer = {"full": True}
    except MemoryError:
        answer = {"refused": "it needs more memory than is given to check it"}
    print(json.dumps(answer))


def _disk_is_full(error: BaseException) -> bool:
    cause: BaseException | None = error
    while cause is not None and not isinstance(cause, OSError):
        cause = cause.__cause__
    return isinstance(cause, OSError) and cause.errno in DISK_FULL


if __name__ == "__main__":
    main()
