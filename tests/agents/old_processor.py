"""A program on this processor, and with the kernels of one without AVX."""

from __future__ import annotations

import os
import subprocess
import sys

OLD = {
    "ATEN_CPU_CAPABILITY": "default",
    "MKL_CBWR": "COMPATIBLE",
    "ONEDNN_MAX_CPU_ISA": "SSE41",
    "OPENBLAS_CORETYPE": "Nehalem",
}
"""Makes the libraries of linear algebra take kernels without AVX."""


def printed_here_and_there(program: str) -> tuple[list[str], list[str]]:
    """Lines that a program prints in both."""
    environment = {name: value for name, value in os.environ.items() if name not in OLD}
    here, old = (
        subprocess.run(
            [sys.executable, "-c", program], env=some, capture_output=True, text=True, check=True
        ).stdout.splitlines()
        for some in (environment, environment | OLD)
    )
    return here, old
