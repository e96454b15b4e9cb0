"""ServiceError: a refusal of the service, or no answer."""

from __future__ import annotations

from functools import partial
from typing import Any, Final

import httpx

from dohyo.service.client.connection import PASSING
from dohyo.service.wire.foreign import Answer, media_type, redirection, told
from dohyo.sumo_networks.errors import DohyoError

JSON: Final = "application/json"
HTML: Final = "text/html"
AWAY: Final = (502, 503, 504)
"""Answers for a service that is busy or starts again."""


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

    @property
    def away(self) -> bool:
        """Whether something else answers for the service, such as a proxy while it restarts."""
        return self.status in AWAY

    @classmethod
    def unreachable(cls, url: str, error: httpx.HTTPError) -> ServiceError:
        """No answer."""
        return cls(0, f"no answer from {url}: {type(error).__name__}: {error}")

    @classmethod
    def of_job(cls, job: dict[str, Any]) -> ServiceError:
        """Failure of a job that has ended without an answer."""
        failure = job["failure"] or {"status": 409, "detail": f"job '{job['id']}' was cancelled"}
        return cls(failure["status"], failure["detail"])


class ForeignAnswerError(ServiceError):
    """An answer that no dohyo service gives.

    Attributes:
        known: Whether a service answered before at this address: then it is a proxy that answers now.
    """

    def __init__(self, url: str, sent: str, status: int = 0, *, known: bool = False) -> None:
        super().__init__(status, told(url, sent))
        self.known = known

    @property
    def passes(self) -> bool:
        """See the base class."""
        return self.known

    @property
    def away(self) -> bool:
        """See the base class."""
        return self.known


def check(response: httpx.Response, url: str) -> httpx.Response:
    """The answer itself.

    Args:
        response: The answer.
        url: Address of the service.

    Raises:
        ForeignAnswerError: It is a redirection.
        ServiceError: It is a refusal.
    """
    if response.is_success:
        return response
    if not response.is_error:
        raise ForeignAnswerError(url, redirection(response.headers.get("location")), response.status_code)
    try:
        detail = str(response.json()["detail"])
    except (ValueError, KeyError, TypeError):
        sent = media_type(response.headers.get("content-type"))
        detail = told(url, sent) if sent == HTML else response.text[:200] or "no reason given"
    wait = response.headers.get("retry-after", "")
    raise ServiceError(response.status_code, detail, float(wait) if wait.isdecimal() else None)


def document_of(response: httpx.Response, url: str, *, known: bool) -> Any:
    """The JSON document of an answer.

    Args:
        response: The answer.
        url: Address of the service.
        known: Whether a service answered before.

    Raises:
        ForeignAnswerError: It is none; later, where a key is read that it lacks.
    """
    sent = media_type(response.headers.get("content-type"))
    if sent not in ("", JSON):
        raise ForeignAnswerError(url, sent, known=known)
    try:
        document = response.json()
    except (ValueError, RecursionError):
        unread = "JSON that cannot be read" if sent else "no JSON"
        raise ForeignAnswerError(url, unread, known=known) from None
    return Answer(document, partial(ForeignAnswerError, url)) if isinstance(document, dict) else document
