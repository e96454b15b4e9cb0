"""Query parameters: one that a route does not have is refused, since ignoring it would answer another question."""

from __future__ import annotations

from collections.abc import Iterator

from fastapi import Request
from fastapi.dependencies.models import Dependant
from fastapi.exceptions import RequestValidationError
from fastapi.routing import APIRoute


async def refuse_unknown(request: Request) -> None:
    """Checks the names of a request's query parameters; a dependency of all routes of the interface.

    Raises:
        RequestValidationError: The route has no parameter of a name.
    """
    route: APIRoute = request.scope["route"]
    request.state.route = route.path  # for the metrics
    if not request.query_params:
        return
    # The document of the interface says the same, and takes a second to make.
    known = list(dict.fromkeys(_names(route.dependant)))
    expected = f"unknown parameter; expected {', '.join(known) or 'none here'}"
    faults = [
        {"type": "extra_forbidden", "loc": ("query", name), "msg": expected}
        for name in request.query_params
        if name not in known
    ]
    if faults:
        raise RequestValidationError(faults)


def _names(dependant: Dependant) -> Iterator[str]:
    """Names of the query parameters of a function, and of those that it depends on."""
    yield from (one.alias for one in dependant.query_params)
    for one in dependant.dependencies:
        yield from _names(one)
