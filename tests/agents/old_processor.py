"""A program on this processor, and with the kernels of one without AVX."""

from __future__ import annotations

import os
import subprocess
import sys

from tests.forked import Python

OLD = {
    "ATEN_CPU_CAPABILITY": "default",
    "MKL_CBWR": "COMPATIBLE",
    "ONEDNN_MAX_CPU_ISA": "SSE41",
    "OPENBLAS_CORETYPE": "Nehalem",
}
"""Makes the libraries of linear algebra take kernels without AVX."""


def printed_here_and_there(program: str) -> tuple[list[str], list[str]]:
    """Lines that a program prints in both."""
    old = subprocess.run(
        [sys.executable, "-c", program], env=os.environ | OLD, capture_output=True, text=True, check=True
    )
    here = Python(program)  # libraries take their kernels once, so that the old ones need a new interpreter
    assert here.end() == 0, here.errors()
    return here.output().splitlines(), old.stdout.splitlines()
