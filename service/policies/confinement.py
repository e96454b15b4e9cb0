"""Confinement: rights that the sandboxed process gives up before it reads a byte of a policy.

Always, or the process refuses to go on:
* limits of address space and processor time; nothing written to files; no new files, processes, threads or core dumps;
* a filter of system calls that leaves memory, time and the open pipes: no open, socket, fork, exec, kill, ptrace
  (Linux on x86-64 and aarch64; the latter's table is read from the kernel's headers, and untested);
* not root: root becomes `nobody`. Any other user is kept.

As root or with user namespaces also, as a second barrier behind the filter:
* an empty root directory;
* a network namespace without interfaces.

Where the kernel allows it, the process is the first to be ended when memory runs out. There is no promise about side
channels.
"""

from __future__ import annotations

import ctypes
import os
import pwd
import resource
import struct
import tempfile
from contextlib import suppress
from typing import Any

from dohyo.service.policies.seccomp import install_filter

_CLONE_NEWUSER, _CLONE_NEWNET = 0x10000000, 0x40000000
_CAPABILITY_VERSION = 0x20080522


def leave_network() -> bool:
    """Moves this single-threaded process to an empty network namespace; returns whether that was allowed."""
    libc = ctypes.CDLL(None, use_errno=True)
    flags = _CLONE_NEWNET if os.geteuid() == 0 else _CLONE_NEWNET | _CLONE_NEWUSER
    return bool(libc.unshare(flags) == 0)


def confine(memory_mb: int, cpu_s: int) -> dict[str, Any]:
    """Gives up every right except computing; nothing can be imported or opened afterwards.

    Args:
        memory_mb: Address space, in megabytes.
        cpu_s: Processor time, in seconds.

    Returns:
        Protections: user id, whether the root directory is empty, whether system calls are filtered.

    Raises:
        OSError: This machine does not allow a required restriction.
    """
    with suppress(OSError), open("/proc/self/oom_score_adj", "w") as file:
        file.write("1000")
    nobody = pwd.getpwnam("nobody") if os.geteuid() == 0 else None
    empty_root = _enter_empty_directory()
    _limit(memory_mb, cpu_s)
    if nobody is not None:
        _become(nobody)
    _drop_capabilities()
    install_filter()
    # Not `getuid`: the filter no longer lets it through.
    return {"uid": nobody.pw_uid if nobody else None, "empty_root": empty_root, "system_calls_filtered": True}


def _become(user: pwd.struct_passwd) -> None:
    try:
        os.setgroups([])
        os.setgid(user.pw_gid)
        os.setuid(user.pw_uid)
    except OSError as error:
        raise OSError(error.errno, f"root may not become '{user.pw_name}': {error.strerror}") from error


def _drop_capabilities() -> None:
    """Drops capabilities that came with a user namespace; `nobody` has none."""
    version_and_self = struct.pack("<Ii", _CAPABILITY_VERSION, 0)
    if ctypes.CDLL(None, use_errno=True).capset(version_and_self, bytes(24)):
        raise OSError(ctypes.get_errno(), f"capset: {os.strerror(ctypes.get_errno())}")


def _enter_empty_directory() -> bool:
    """Changes to a deleted directory, which stays empty; returns whether it became the root directory."""
    directory = tempfile.mkdtemp(prefix="dohyo-policy-")
    os.chdir(directory)
    os.rmdir(directory)
    try:
        os.chroot(".")
    except OSError:
        return False
    return True


def _limit(memory_mb: int, cpu_s: int) -> None:
    memory = memory_mb * 1_000_000
    limits = {
        resource.RLIMIT_AS: memory,
        resource.RLIMIT_FSIZE: 0,
        resource.RLIMIT_NOFILE: 0,
        resource.RLIMIT_NPROC: 0,
        resource.RLIMIT_CORE: 0,
        resource.RLIMIT_MEMLOCK: 0,
    }
    for which, most in limits.items():
        hard = resource.getrlimit(which)[1]
        least = most if hard == resource.RLIM_INFINITY else min(most, hard)
        resource.setrlimit(which, (least, least))
    # The soft limit sends SIGXCPU, which names the reason; the hard one sends SIGKILL.
    resource.setrlimit(resource.RLIMIT_CPU, (cpu_s, cpu_s + 1))
