"""Sends made-up requests of every role to a service: `python -m tests.performance.fuzz --role ROLE --examples N`.

Prints each operation and, at the end, the faults: 5xx, statuses that are not documented, refusals that are no problem
documents. Exit code 1 if there is one.
"""

from __future__ import annotations

import argparse
import logging
import sys
import tempfile
from pathlib import Path

from tests.service.web.fuzzing import CALLERS, find_faults, listening


def main() -> int:
    """Runs the command line and returns its exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--role", choices=CALLERS, action="append", help="repeatable; default: all")
    parser.add_argument("--examples", type=int, default=200, help="cases of each operation, each sent by every role")
    parser.add_argument("--only", default="", help="part of the paths to try, such as /v1/challenges")
    given = parser.parse_args()
    logging.getLogger("dohyo").setLevel(logging.CRITICAL)
    with tempfile.TemporaryDirectory() as folder, listening(Path(folder) / "data") as (url, service):
        roles = given.role or list(CALLERS)
        faults = find_faults(url, service, roles, given.examples, True, given.only, lambda one: print(one, flush=True))
    print(*(faults or ["no fault"]), sep="\n")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
