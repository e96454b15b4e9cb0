"""Commands of sessions, as one types them in a checkout."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path


def typed(arguments: Sequence[str]) -> str:
    """The command of a process from its `sys.argv`: "python -m MODULE ..." for a module of dohyo, else the program.

    Paths below the checkout that a module was run from become relative to it.
    """
    program, *rest = arguments
    checkout, inside, file = program.rpartition("/dohyo/")
    if not (inside and file.endswith(".py")):
        return shlex.join([Path(program).name, *rest])
    parts = Path(file).with_suffix("").parts
    module = ".".join(("dohyo", *parts)).removesuffix(".__main__")
    return shlex.join(["python", "-m", module, *(one.replace(f"{checkout}/", "") for one in rest)])
