"""Modules of the user's own: found in the folder where the command runs."""

from __future__ import annotations

import os
import sys


def find_own_modules() -> None:
    """Lets imports see the current folder first; worker processes take over the search path of their parent."""
    here = os.getcwd()
    if sys.path[:1] != [here]:
        sys.path.insert(0, here)
