"""Landlock: the kernel's own access control for files, for processes without privileges (Linux 5.13 and later).

Once restricted, a process and all that it starts can open nothing outside the given folders, for ever. Newer kernels
also refuse TCP, signals to other processes and abstract sockets.

Source: the kernel's documentation of Landlock, and its header linux/landlock.h.
"""

from __future__ import annotations

import ctypes
import os
import struct
from collections.abc import Iterable
from enum import IntFlag
from functools import cache
from pathlib import Path

_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446  # the same on all machines
_ASK_VERSION = 1
_RULE_PATH = 1
_PR_SET_NO_NEW_PRIVS = 38
_ALL_TCP, _ALL_SCOPES = 0b11, 0b11


class Access(IntFlag):
    """Rights on a folder and what lies in it, or on a file."""

    EXECUTE = 1 << 0
    WRITE_FILE = 1 << 1
    READ_FILE = 1 << 2
    READ_DIR = 1 << 3
    TRUNCATE = 1 << 14


READ = Access.READ_FILE | Access.READ_DIR
RUN = READ | Access.EXECUTE
_OF_FILES = Access.EXECUTE | Access.WRITE_FILE | Access.READ_FILE | Access.TRUNCATE


@cache
def version() -> int:
    """Version of Landlock in this kernel; 0: none."""
    answer = ctypes.CDLL(None, use_errno=True).syscall(_CREATE_RULESET, None, ctypes.c_size_t(0), _ASK_VERSION)
    return max(int(answer), 0)


def everything() -> int:
    """All rights on files that this kernel knows, writing included."""
    known = {1: 13, 2: 14, 3: 15, 4: 15}
    return (1 << known.get(version(), 16)) - 1


def restrict(rules: Iterable[tuple[Path, int]]) -> None:
    """Takes from this process, which must have one thread, all access to files beyond the rules.

    Args:
        rules: Paths and the rights on them; a path that does not exist is left out.

    Raises:
        OSError: The kernel refuses.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    now = version()
    attributes = struct.pack("<3Q", everything(), _ALL_TCP if now >= 4 else 0, _ALL_SCOPES if now >= 6 else 0)
    ruleset = _checked(libc.syscall(_CREATE_RULESET, attributes, ctypes.c_size_t(_attribute_bytes(now)), 0))
    try:
        for path, rights in rules:
            _allow(libc, ruleset, path, rights & everything())
        if libc.prctl(_PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0):
            raise OSError(ctypes.get_errno(), "no_new_privs")
        _checked(libc.syscall(_RESTRICT_SELF, ruleset, 0))
    finally:
        os.close(ruleset)


def _attribute_bytes(now: int) -> int:
    return 24 if now >= 6 else 16 if now >= 4 else 8


def _allow(libc: ctypes.CDLL, ruleset: int, path: Path, rights: int) -> None:
    try:
        opened = os.open(path, os.O_PATH | os.O_CLOEXEC)
    except OSError:
        return
    try:
        if not path.is_dir():
            rights &= _OF_FILES
        rule = struct.pack("<Qi", rights, opened)
        _checked(libc.syscall(_ADD_RULE, ruleset, _RULE_PATH, rule, 0))
    finally:
        os.close(opened)


def _checked(answer: int) -> int:
    if answer < 0:
        raise OSError(ctypes.get_errno(), f"landlock: {os.strerror(ctypes.get_errno())}")
    return answer
