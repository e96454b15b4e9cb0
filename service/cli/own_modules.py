"""The user's own modules, found in the current folder."""

from __future__ import annotations

import os
import sys


def find_own_modules() -> None:
    """Puts the current folder first on the search path, which worker processes inherit."""
    here = os.getcwd()
    if sys.path[:1] != [here]:
        sys.path.insert(0, here)
