"""Errors of the service, and their answers as `application/problem+json` (RFC 9457)."""

from __future__ import annotations

import errno
import json
import logging
from collections.abc import Mapping
from http import HTTPStatus
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from sqlalchemy.exc import DataError, DBAPIError, IntegrityError
from sqlalchemy.exc import TimeoutError as PoolTimeoutError
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect

from dohyo.evaluation.settings import SettingsError
from dohyo.service.database.engine import FencedError
from dohyo.service.web.spelling import expected_spelling
from dohyo.sumo_networks.errors import DohyoError, InvalidInputError, SimulationError, UnknownNameError

PROBLEM = "application/problem+json"
RETRY_S = 5
FAULTS = 20
DISK_FULL = frozenset((errno.ENOSPC, errno.EDQUOT, errno.EFBIG))

logger = logging.getLogger("dohyo.service")


class ServiceError(DohyoError):
    """A request that is refused.

    Attributes:
        status: HTTP status of the answer.
        headers: Headers of the answer.
    """

    status = 500

    def __init__(self, detail: str, headers: Mapping[str, str] | None = None) -> None:
        super().__init__(detail)
        self.headers = dict(headers or {})


class BodyError(InvalidInputError):
    """A well-formed body that does not fit what is stored.

    Attributes:
        place: Keys that lead to the fault, such as "egos.east-2".
        expected: What was expected there.
    """

    def __init__(self, place: str, expected: str) -> None:
        super().__init__(f"body.{place}: {expected}")
        self.place, self.expected = place, expected


class UnauthorisedError(ServiceError):
    """The token is missing, unknown, expired or revoked; the answer does not say which."""

    status = 401

    def __init__(self, detail: str = "expected a valid bearer token in the Authorization header") -> None:
        super().__init__(detail, {"www-authenticate": "Bearer"})


class ForbiddenError(ServiceError):
    """The token is valid but does not permit the request."""

    status = 403


class NotFoundError(ServiceError):
    """The resource does not exist or is not visible to the caller."""

    status = 404


class ConflictError(ServiceError):
    """The request conflicts with the current state."""

    status = 409


class GoneError(ServiceError):
    """The resource existed and is gone for ever."""

    status = 410


class TooLargeError(ServiceError):
    """The body is larger than the limit."""

    status = 413

    def __init__(self, limit: int) -> None:
        super().__init__(f"the body is larger than {limit} bytes", {"connection": "close"})


class TooManyRequestsError(ServiceError):
    """The caller exceeds a quota or a rate limit."""

    status = 429

    def __init__(self, detail: str, retry_s: float = RETRY_S) -> None:
        super().__init__(detail, {"retry-after": str(max(1, round(retry_s)))})


class BusyError(ServiceError):
    """The service is busy: a queue is full, the database is locked, or the service is shutting down."""

    status = 503

    def __init__(self, detail: str, retry_s: float = RETRY_S) -> None:
        super().__init__(detail, {"retry-after": str(max(1, round(retry_s)))})


class StorageFullError(ServiceError):
    """The disk is full; nothing of the request was stored."""

    status = 507

    def __init__(self, detail: str = "no space is left to store this; nothing of it was kept") -> None:
        super().__init__(detail)


def problem(status: int, detail: str, headers: Mapping[str, str] | None = None, **members: Any) -> JSONResponse:
    """An error as a problem document.

    Args:
        status: Of HTTP.
        detail: One line with the expected and the received value.
        headers: Headers of the answer.
        members: More of the document, such as the `errors` of a body.
    """
    body = {"type": "about:blank", "title": HTTPStatus(status).phrase, "status": status, "detail": detail, **members}
    return JSONResponse(body, status, headers, media_type=PROBLEM)


def as_service_error(error: Exception) -> DohyoError | None:
    """An infrastructure error as an answer that callers can act on; None for an internal error."""
    if isinstance(error, ServiceError):
        return error
    if isinstance(error, OSError):
        return StorageFullError() if error.errno in DISK_FULL else None
    if isinstance(error, PoolTimeoutError):
        return BusyError("the database is busy")
    if isinstance(error, IntegrityError):
        return ConflictError("it conflicts with stored data, perhaps of a simultaneous request")
    if isinstance(error, DataError):
        return InvalidInputError("the request holds a value that cannot be stored, such as a NUL character")
    if isinstance(error, FencedError):
        return BusyError("this server has lost its lock on the database and takes no work until it has it again")
    if not isinstance(error, DBAPIError):
        return None
    told = str(error.orig).lower()
    if "disk is full" in told or "no space left" in told:
        return StorageFullError()
    if error.connection_invalidated or any(sign in told for sign in _BUSY_SIGNS):
        return BusyError("the database is busy or cannot be reached")
    return None


_BUSY_SIGNS = (
    *("locked", "lock timeout", "busy", "deadlock", "statement timeout", "could not serialize"),
    *("connection failed", "connection refused", "too many clients", "closed the connection", "the database system is"),
)


def problem_document(error: Exception, name: str = "unknown") -> dict[str, Any]:
    """An error of work outside of a request as the problem document that a request would be answered.

    Args:
        error: Any error; an unexpected one is logged whole.
        name: What failed, for the log.
    """
    known = error if isinstance(error, DohyoError) else as_service_error(error)
    if known is None:
        logger.error("%s failed", name, exc_info=error)
        answer = problem(500, f"an error of the service; its log tells more under {name}")
    else:
        answer = _answer(known)
    document: dict[str, Any] = json.loads(bytes(answer.body))
    return document


def install(app: FastAPI) -> None:
    """Registers the handlers."""
    app.add_exception_handler(DohyoError, _dohyo_error)
    app.add_exception_handler(RequestValidationError, _invalid_request)
    app.add_exception_handler(HTTPException, _http_exception)
    app.add_exception_handler(ClientDisconnect, _client_left)
    for kind in (OSError, DBAPIError, PoolTimeoutError):
        app.add_exception_handler(kind, _infrastructure)
    app.add_exception_handler(Exception, _unexpected)


def _dohyo_error(request: Request, error: Exception) -> JSONResponse:
    return _answer(error)


def _answer(error: Exception) -> JSONResponse:
    if isinstance(error, ServiceError):
        return problem(error.status, str(error), error.headers)
    if isinstance(error, SettingsError):
        faults = [{"where": f"body.settings.{name}", "expected": fault} for name, fault in error.faults.items()]
        return problem(422, str(error), errors=faults[:FAULTS])
    if isinstance(error, BodyError):
        return problem(422, str(error), errors=[{"where": f"body.{error.place}", "expected": error.expected}])
    if isinstance(error, UnknownNameError):
        return problem(404, str(error))
    if isinstance(error, InvalidInputError):
        return problem(422, str(error))
    if isinstance(error, SimulationError):
        logger.error("infrastructure fault: %s", error)
        return problem(503, "the simulation or a sandbox failed on this machine; try again", {"retry-after": "5"})
    return problem(422, str(error))


def _invalid_request(request: Request, error: Exception) -> JSONResponse:
    """Names the place and the expected value of each fault, but not the received one, which may be a secret."""
    given = error.errors() if isinstance(error, RequestValidationError) else []
    body = error.body if isinstance(error, RequestValidationError) else None
    faults = [{"where": ".".join(_place(one, body)), "expected": _expected(one)} for one in given]
    first = faults[0] if faults else {"where": "request", "expected": "another one"}
    return problem(422, f"{first['where']}: {first['expected']}", errors=faults[:FAULTS])


def _place(fault: Mapping[str, Any], body: object) -> list[str]:
    """The place of a fault in a body, without the names that the validator gives to the variants of a value."""
    first, *parts = fault["loc"]
    place, here = [str(first)], body if first == "body" else None
    for number, part in enumerate(parts, start=1):
        of_missing = number == len(parts) and (fault["type"] == "missing" or part == "[key]")
        if isinstance(here, dict) and part not in here and not of_missing:
            continue
        place.append(str(part))
        if isinstance(here, dict):
            here = here.get(part)
        elif isinstance(here, list) and isinstance(part, int) and part < len(here):
            here = here[part]
        else:
            here = None
    return place


def _expected(fault: Mapping[str, Any]) -> str:
    """What was expected; of a name, how it is spelled."""
    if fault["type"] == "string_pattern_mismatch":
        return expected_spelling(fault["ctx"]["pattern"])
    return str(fault["msg"])


def _http_exception(request: Request, error: Exception) -> JSONResponse:
    if not isinstance(error, HTTPException):
        return _unexpected(request, error)
    return problem(error.status_code, str(error.detail), error.headers)


def _client_left(request: Request, error: Exception) -> JSONResponse:
    """Nobody reads this answer; its status is for the log."""
    return problem(408, "the connection ended before the request had come")


def _infrastructure(request: Request, error: Exception) -> JSONResponse:
    known = as_service_error(error)
    if known is None:
        return _unexpected(request, error)
    logger.warning("%s: %s", type(error).__name__, known)
    return _dohyo_error(request, known)


def _unexpected(request: Request, error: Exception) -> JSONResponse:
    """Logs the whole error; the caller gets only the request's identifier."""
    name = getattr(request.state, "request_id", "unknown")
    logger.error("request %s failed", name, exc_info=error)
    return problem(500, f"an error of the service; its log tells more under request {name}", {"x-request-id": name})
