"""Layers: which means of confinement this machine has, for the log at the start and for the health check."""

from __future__ import annotations

import logging
import os
from functools import cache
from typing import Any

from dohyo.service.confinement.errors import ConfinementError
from dohyo.service.confinement.folders import remove_leftovers
from dohyo.service.confinement.limits import Limits
from dohyo.service.confinement.probe import TASKS
from dohyo.service.confinement.process import ConfinedProcess
from dohyo.service.confinement.tasks import Rights

logger = logging.getLogger("dohyo.confinement")


@cache
def layers() -> dict[str, Any]:
    """Layers that are active here, found by starting a confined process.

    Returns:
        `available`: whether work of strangers can be confined at all, else nothing of it is run; `system_calls`,
        `files`, `network`: whether the filter, Landlock and an own network namespace are active; `missing`: sentences.
    """
    try:
        process = ConfinedProcess(TASKS[Rights.COMPUTE], Limits())  # the quickest to start
        process.end()
    except ConfinementError as error:
        nothing = dict.fromkeys(("available", "system_calls", "files", "network"), False)
        return nothing | {"missing": [str(error)]}
    found, missing = process.layers, []
    if not found["landlock"]:
        reads = (
            "whatever the service's user can read" if os.geteuid() else "as 'nobody', who may not see the installation"
        )
        missing.append(f"Landlock (Linux 5.13): a confined task reads {reads}")
    if not found["own_network"]:
        missing.append("network namespaces: only the filter of system calls keeps a confined task off the network")
    return {
        "available": True,
        "system_calls": True,
        "files": bool(found["landlock"]),
        "network": bool(found["own_network"]),
        "missing": missing,
    }


def prepare_confinement() -> None:
    """Removes what killed services left, and logs which layers are active; for the start of the service."""
    remove_leftovers()
    found = layers()
    if not found["available"]:
        logger.error("work of strangers cannot be confined here, so none is run: %s", found["missing"][0])
        return
    active = ", ".join(name for name in ("system_calls", "files", "network") if found[name])
    logger.info("confinement: %s", active)
    for sentence in found["missing"]:
        logger.warning("confinement is weaker without %s", sentence)
