"""Confinement in a container, whose runtime has a filter of system calls of its own."""

from __future__ import annotations

import subprocess
import sys

import pytest

_CONTAINER = """
import ctypes
libc = ctypes.CDLL(None, use_errno=True)
class Program(ctypes.Structure):
    _fields_ = (("length", ctypes.c_uint16), ("instructions", ctypes.c_char_p))
allow_all = (0x06).to_bytes(2, "little") + bytes(2) + (0x7FFF0000).to_bytes(4, "little")
assert libc.prctl(38, 1, 0, 0, 0) == 0
assert libc.prctl(22, 2, ctypes.byref(Program(1, allow_all)), 0, 0) == 0
"""
_OURS = """
from dohyo.service.confinement.seccomp import install_filter
from dohyo.service.confinement.tasks import Rights
install_filter(Rights.{rights})
"""
_ASK = """
from dohyo.service.confinement.seccomp import is_filtered
import os
os.write(1, str(is_filtered()).encode())
os._exit(0)
"""


def _filtered(*parts: str) -> str:
    ended = subprocess.run([sys.executable, "-c", "".join(parts)], capture_output=True, text=True, check=True)
    return ended.stdout


def test_a_container_is_no_confined_process() -> None:
    assert _filtered(_ASK) == "False"
    assert _filtered(_CONTAINER, _ASK) == "False"


@pytest.mark.parametrize("rights", ["FILES", "PROGRAMS"])
def test_a_confined_process_in_a_container_is_one(rights: str) -> None:
    loaded = "from dohyo.service.confinement.seccomp import is_filtered\n"  # no file can be opened afterwards
    assert _filtered(loaded, _CONTAINER, _OURS.format(rights=rights), _ASK) == "True"
