"""Rights that a confined process gives up before it reads a byte that a stranger sent.

Always, or the process refuses to go on:
* limits of memory, processor time and file sizes; no core dumps;
* a filter of system calls (`seccomp`): no network, no signals to other processes, no way out of its process group
  (Linux on x86-64 and aarch64; the latter's table is read from the kernel's headers, and untested);
* no capabilities.

Where the kernel allows it (`layers` says what is so here):
* Landlock: no file beyond the installation, the given paths and the private folder (Linux 5.13);
* a network and an IPC namespace of its own, as root or with user namespaces;
* for tasks that compute only: an empty root directory, and `nobody` in place of root. The others stay the user that
  they are, since they read the service's files; without Landlock root becomes `nobody` there too.

Where the kernel allows it, the process is the first to be ended when memory runs out. There is no promise about side
channels.
"""

from __future__ import annotations

import ctypes
import math
import os
import pwd
import resource
import struct
import tempfile
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from dohyo.service.confinement import landlock
from dohyo.service.confinement.folders import SYSTEM, installation, other_code
from dohyo.service.confinement.limits import MEGABYTE, Limits
from dohyo.service.confinement.seccomp import install_filter, is_filtered
from dohyo.service.confinement.tasks import Rights

EPISODE_MEMORY_MB = 16_000

_CLONE_NEWIPC, _CLONE_NEWUSER, _CLONE_NEWNET = 0x08000000, 0x10000000, 0x40000000
_CAPABILITY_VERSION = 0x20080522


def leave_network() -> bool:
    """Moves this single-threaded process to an empty network namespace; returns whether that was allowed."""
    libc = ctypes.CDLL(None, use_errno=True)
    flags = _CLONE_NEWNET | _CLONE_NEWIPC
    return bool(libc.unshare(flags if os.geteuid() == 0 else flags | _CLONE_NEWUSER) == 0)


def give_up(rights: Rights, limits: Limits, folder: Path, reads: Iterable[Path]) -> dict[str, Any]:
    """Gives up every right but the given ones; `seccomp.install_filter` is the last step.

    A process that only computes can import and open nothing afterwards.

    Args:
        rights: Rights to keep.
        limits: Limits of the process.
        folder: Private folder, or for a process that only computes, the folder for temporary files.
        reads: Files and folders that it may read besides the installation.

    Returns:
        Layers that are active: user id it changed to, whether its root directory is empty, Landlock's version.

    Raises:
        OSError: This machine does not allow a required restriction.
    """
    if not is_filtered() and len(os.listdir("/proc/self/task")) != 1:  # inside another confined process: unreadable
        raise OSError("expected a process with one thread, since Landlock restricts only the calling one")
    with suppress(OSError), open("/proc/self/oom_score_adj", "w") as file:
        file.write("1000")
    user = _other_user(rights)
    empty_root = _enter_empty_directory(folder) if rights is Rights.COMPUTE else False
    if landlock.version():
        landlock.restrict(() if rights is Rights.COMPUTE else _rules(rights, folder, reads))
    _limit(rights, limits)
    if user is not None:
        if rights is not Rights.COMPUTE:
            os.chown(folder, user.pw_uid, user.pw_gid)
        _become(user)
    _drop_capabilities()
    return {"uid": user.pw_uid if user else None, "empty_root": empty_root, "landlock": landlock.version()}


def _other_user(rights: Rights) -> pwd.struct_passwd | None:
    """User that root becomes; None: it stays who it is, as any other user and as one whose rights are gone already."""
    if os.geteuid() != 0 or is_filtered() or (rights is not Rights.COMPUTE and landlock.version()):
        return None
    return pwd.getpwnam("nobody")


def _rules(rights: Rights, folder: Path, reads: Iterable[Path]) -> list[tuple[Path, int]]:
    run = landlock.RUN if rights is Rights.PROGRAMS else landlock.READ
    return [
        *((path, run) for path in (*installation(), *map(Path, SYSTEM))),
        *((path, landlock.Access.READ_DIR) for path in other_code()),
        *((path, landlock.READ) for path in reads),
        (Path(os.devnull), landlock.READ | landlock.Access.WRITE_FILE),
        (folder, landlock.everything() & ~landlock.Access.EXECUTE),
    ]


def _become(user: pwd.struct_passwd) -> None:
    try:
        os.setgroups([])
        os.setgid(user.pw_gid)
        os.setuid(user.pw_uid)
    except OSError as error:
        raise OSError(error.errno, f"root may not become '{user.pw_name}': {error.strerror}") from error


def _drop_capabilities() -> None:
    """Drops all capabilities: root's, or those that came with a user namespace."""
    version_and_self = struct.pack("<Ii", _CAPABILITY_VERSION, 0)
    if ctypes.CDLL(None, use_errno=True).capset(version_and_self, bytes(24)):
        raise OSError(ctypes.get_errno(), f"capset: {os.strerror(ctypes.get_errno())}")


def _enter_empty_directory(parent: Path) -> bool:
    """Changes to a deleted directory, which stays empty; returns whether it became the root directory."""
    directory = tempfile.mkdtemp(prefix="dohyo-empty-", dir=parent)
    os.chdir(directory)
    os.rmdir(directory)
    try:
        os.chroot(".")
    except OSError:
        return False
    return True


def _limit(rights: Rights, limits: Limits) -> None:
    alone = rights is Rights.COMPUTE
    most = {
        resource.RLIMIT_AS: limits.address_mb * MEGABYTE,
        resource.RLIMIT_DATA: limits.memory_mb * MEGABYTE,
        resource.RLIMIT_FSIZE: 0 if alone else limits.file_mb * MEGABYTE,
        resource.RLIMIT_CORE: 0,
        resource.RLIMIT_MEMLOCK: 0,
    }
    if alone:
        most |= {resource.RLIMIT_NOFILE: 0, resource.RLIMIT_NPROC: 0}
    _limit_to(most)


def _limit_to(most: Mapping[int, int]) -> None:
    for which, value in most.items():
        hard = resource.getrlimit(which)[1]
        least = value if hard == resource.RLIM_INFINITY else min(value, hard)
        resource.setrlimit(which, (least, least))


def confine_episodes() -> None:
    """Confines a process that drives episodes: no network, no signals to other processes, limited memory.

    It runs code of the installation only, with settings that strangers chose, and writes records to the data folder, so
    its files are not confined. Without effect where the kernel has no filters; `layers` tells of it at the start.
    """
    _limit_to({resource.RLIMIT_DATA: EPISODE_MEMORY_MB * MEGABYTE, resource.RLIMIT_CORE: 0})
    with suppress(OSError):
        install_filter(Rights.PROGRAMS)


def limit_processor_time(seconds: int) -> None:
    """Limits the processor time from now on, of this process and of each that it starts."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    last = math.ceil(used.ru_utime + used.ru_stime) + seconds
    hard = resource.getrlimit(resource.RLIMIT_CPU)[1]
    if hard == resource.RLIM_INFINITY or hard > last + 1:
        # The soft limit sends SIGXCPU, which names the reason; the hard one sends SIGKILL.
        resource.setrlimit(resource.RLIMIT_CPU, (last, last + 1))
