"""Limits: resources of one confined task."""

from __future__ import annotations

from dataclasses import dataclass

MEGABYTE = 1_000_000


@dataclass(frozen=True, slots=True)
class Limits:
    """Resources of one confined task, its programs included.

    Attributes:
        wall_s: Wall-clock time of the task, s; its start is not counted.
        cpu_s: Processor time of each process, s.
        memory_mb: Memory in use: of each process by the kernel, of all together by the runner.
        address_mb: Address space of each process; libraries reserve more than they use.
        file_mb: Size of each file.
        folder_mb: Size of all files in the private folder together.
        processes: Number of processes, where the task may start programs.
        answer_mb: Size of the answer.
    """

    wall_s: float = 60.0
    cpu_s: int = 60
    memory_mb: int = 3000
    address_mb: int = 8000
    file_mb: int = 500
    folder_mb: int = 1000
    processes: int = 16
    answer_mb: float = 4.0
