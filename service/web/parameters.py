"""Query parameters: one that a route does not have is refused, since ignoring it would answer another question."""

from __future__ import annotations

from fastapi import Request
from fastapi.exceptions import RequestValidationError


async def refuse_unknown(request: Request) -> None:
    """Checks the names of a request's query parameters; a dependency of all routes of the interface.

    Raises:
        RequestValidationError: The route has no parameter of a name.
    """
    path: str = request.scope["route"].path
    request.state.route = path  # for the metrics
    if not request.query_params:
        return
    operation = request.app.openapi()["paths"].get(path, {}).get(request.method.lower(), {})
    known = [one["name"] for one in operation.get("parameters", ()) if one["in"] == "query"]
    expected = f"unknown parameter; expected {', '.join(known) or 'none here'}"
    faults = [
        {"type": "extra_forbidden", "loc": ("query", name), "msg": expected}
        for name in request.query_params
        if name not in known
    ]
    if faults:
        raise RequestValidationError(faults)
