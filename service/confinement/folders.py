"""Folders of confined tasks: a private one for each, and those of the installation, which they may read."""

from __future__ import annotations

import os
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import dohyo

PREFIX = "dohyo-confined-"
MOST_FILES = 10_000
FLOORS = ("sumo_networks", "evaluation", "agents", "service")
PACKAGES = ("site-packages", "dist-packages")
SYSTEM = (
    *("/lib", "/lib64", "/usr/lib", "/usr/lib64", "/usr/share/zoneinfo", "/etc/ld.so.cache", "/etc/localtime"),
    *("/dev/null", "/dev/zero", "/dev/urandom", "/proc/cpuinfo", "/proc/meminfo", "/proc/stat", "/proc/self"),
    *("/sys/devices/system/cpu", "/sys/devices/system/node"),
)


@contextmanager
def private_folder() -> Iterator[Path]:
    """A new empty folder, removed with its content at the end of the block."""
    folder = Path(tempfile.mkdtemp(prefix=f"{PREFIX}{os.getpid()}-")).resolve()
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def remove_leftovers() -> None:
    """Removes private folders of processes that were killed."""
    for folder in Path(tempfile.gettempdir()).glob(f"{PREFIX}*-*"):
        owner = folder.name.removeprefix(PREFIX).partition("-")[0]
        if owner.isdecimal() and not Path(f"/proc/{owner}").exists() and folder.lstat().st_uid == os.geteuid():
            shutil.rmtree(folder, ignore_errors=True)


def size_of(folder: Path) -> int:
    """Bytes in all files of a folder; a folder of too many files counts as endless."""
    total, seen, left = 0, 0, [folder]
    while left:
        try:
            entries = list(os.scandir(left.pop()))
        except OSError:  # removed meanwhile
            continue
        for entry in entries:
            seen += 1
            try:
                state = entry.stat(follow_symlinks=False)
            except OSError:
                continue
            total += state.st_blocks * 512
            if stat.S_ISDIR(state.st_mode):
                left.append(Path(entry.path))
        if seen > MOST_FILES:
            return sys.maxsize
    return total


def installation() -> list[Path]:
    """Folders with the code and the data of Python, of dohyo and of the libraries that it uses."""
    package = Path(dohyo.__path__[0])
    floors = [(package / floor).resolve() for floor in FLOORS]  # links in a working copy
    packages = [entry for entry in map(Path, sys.path) if entry.name in PACKAGES]
    metadata = [found for entry in other_code() for found in entry.glob("*-info")]
    return [Path(sys.prefix), Path(sys.base_prefix), *packages, package, *floors, *metadata]


def other_code() -> list[Path]:
    """Folders that Python looks for modules in, such as a working copy: they may hold anything, so are only listed."""
    return [entry for entry in map(Path, sys.path) if entry.is_dir() and entry.name not in PACKAGES]
