"""ServiceError: a refusal of the service, or no answer."""

from __future__ import annotations

from typing import Any

import httpx

from dohyo.service.client.worker_session import PASSING
from dohyo.sumo_networks.errors import DohyoError


class ServiceError(DohyoError):
    """A refusal of the service, or a service that cannot be reached.

    Attributes:
        status: HTTP status; 0 without an answer.
        detail: The expected and the received input.
        retry_s: Seconds to wait before a retry, where the service gave them.
    """

    def __init__(self, status: int, detail: str, retry_s: float | None = None) -> None:
        super().__init__(f"{detail} (HTTP {status})" if status else detail)
        self.status, self.detail, self.retry_s = status, detail, retry_s

    @property
    def passes(self) -> bool:
        """Whether the same question may be answered later, such as once the service has restarted."""
        return self.status in (0, *PASSING)

    @classmethod
    def unreachable(cls, url: str, error: httpx.HTTPError) -> ServiceError:
        """No answer."""
        return cls(0, f"no answer from {url}: {type(error).__name__}: {error}")

    @classmethod
    def of_job(cls, job: dict[str, Any]) -> ServiceError:
        """Failure of a job that has ended without an answer."""
        failure = job["failure"] or {"status": 409, "detail": f"job '{job['id']}' was cancelled"}
        return cls(failure["status"], failure["detail"])


def check(response: httpx.Response) -> httpx.Response:
    """The answer itself.

    Raises:
        ServiceError: It is a refusal.
    """
    if response.is_success:
        return response
    try:
        detail = str(response.json()["detail"])
    except (ValueError, KeyError, TypeError):
        detail = response.text[:200] or "no reason given"
    wait = response.headers.get("retry-after", "")
    raise ServiceError(response.status_code, detail, float(wait) if wait.isdecimal() else None)
