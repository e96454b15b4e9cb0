"""Blame: what an agent's call may raise, and whether that is its own fault, the user's or the machine's."""

from __future__ import annotations

import signal
from asyncio import CancelledError
from typing import Final

from dohyo.sumo_networks.errors import SimulationError

RAISED: Final = (Exception, SystemExit, KeyboardInterrupt, CancelledError)
"""What an agent's code may raise while others must go on; it may want to end the process, too."""


def is_blameless(error: BaseException, agent: object) -> bool:
    """Whether the user or the machine ended a call of an agent.

    Only dohyo's own agents may report a failed machine, such as a sandbox that cannot start: no mean has the drives
    lost by it. A KeyboardInterrupt is the agent's own where Ctrl-C is ignored, as in worker processes.
    """
    if isinstance(error, KeyboardInterrupt):
        return signal.getsignal(signal.SIGINT) is not signal.SIG_IGN
    return isinstance(error, SimulationError) and type(agent).__module__.startswith("dohyo.")
