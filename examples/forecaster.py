"""A policy worker that forecasts the speeds of a road's segments.

    python examples/forecaster.py http://127.0.0.1:8000 TOKEN my-forecaster [DAYS]

It claims days from the service: episodes of its evaluations on `forecast-easy` and `forecast-hard`. Once per simulated
minute it gets the speeds of the last eight minutes and answers those of the next three: the last speed, moved towards
the mean of the eight.
"""

from __future__ import annotations

import logging
import sys

import numpy as np

from dohyo.service.client.worker_session import BadActionError, UnreachableError, WireError, WorkerSession

TOWARDS_MEAN = (0.1, 0.2, 0.3)
"""Share of the way from the last speed to the mean, for each minute ahead."""


def forecast(history: np.ndarray) -> np.ndarray:
    """(3, N) speeds of the next minutes [m/s] from (8, N) speeds of the last ones [m/s], the oldest first."""
    last, mean = history[-1], history.mean(axis=0)
    return np.stack([last + share * (mean - last) for share in TOWARDS_MEAN])


class Changed(logging.Filter):
    """Lets a line pass unless the one before said the same: during a restart of the service, each try gives one."""

    last = ""

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether it is another line."""
        before, self.last = self.last, record.getMessage()
        return self.last != before


def main() -> None:
    """Forecasts the given number of days, or runs until it is stopped."""
    if len(sys.argv) < 4:
        sys.exit(__doc__)
    url, token, agent, *rest = sys.argv[1:]
    left = int(rest[0]) if rest else -1
    logging.basicConfig(format=f"{url}: %(message)s")
    logging.getLogger("dohyo.worker").addFilter(Changed())
    with WorkerSession(url, token, agent) as session:
        while left:
            drive = session.next_drive()  # waits, also for a service that is restarted
            try:
                while not drive.done:
                    session.step(drive, {name: forecast(seen["history"]) for name, seen in drive.observations.items()})
            except BadActionError:  # a fault of this program
                raise
            except (UnreachableError, WireError) as error:  # the episode is lost, such as by a restart
                print(f"{url}: {error}", flush=True)
                continue
            if drive.directive != "abort":  # neither cancelled nor ended by the service
                print(f"a day until {drive.time_s / 3600:.2f} h", flush=True)
                left -= 1


if __name__ == "__main__":
    main()
