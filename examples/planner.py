"""A policy worker that plans the speeds of connected cars on the freeway.

    python examples/planner.py http://127.0.0.1:8000 TOKEN my-planner [MORNINGS]

It claims mornings from the service: episodes of its evaluations on the benchmark `dissipation`. Once per simulated
minute it publishes the mean speed over the next kilometre as the target speed, so that vehicles approach a slow area
slowly.
"""

from __future__ import annotations

import sys

import numpy as np

from dohyo.service.client.worker_session import BadActionError, UnreachableError, WireError, WorkerSession

AHEAD = 10
"""Number of cells of 100 m that are averaged."""


def plan(speeds: np.ndarray) -> np.ndarray:
    """(L, X) target speeds [m/s] from (L, X) measured speeds [m/s] along each lane."""
    padded = np.pad(speeds, ((0, 0), (0, AHEAD - 1)), mode="edge")
    ahead = np.lib.stride_tricks.sliding_window_view(padded, AHEAD, axis=1)
    return np.asarray(ahead.mean(axis=2), dtype=np.float32)


def main() -> None:
    """Plans the given number of mornings, or runs until it is stopped."""
    if len(sys.argv) < 4:
        sys.exit(__doc__)
    url, token, agent, *rest = sys.argv[1:]
    left = int(rest[0]) if rest else -1
    with WorkerSession(url, token, agent) as session:
        while left:
            drive = session.next_drive()  # waits, also for a service that is restarted
            try:
                while not drive.done:
                    session.step(drive, {name: plan(seen["speeds"]) for name, seen in drive.observations.items()})
                    print(f"{drive.time_s / 3600:.2f} h", flush=True)
            except BadActionError:  # a fault of this program
                raise
            except (UnreachableError, WireError) as error:  # the episode is lost, such as by a restart
                print(error, flush=True)
                continue
            if drive.directive != "abort":  # neither cancelled nor ended by the service
                left -= 1


if __name__ == "__main__":
    main()
