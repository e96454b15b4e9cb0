"""OpenAPI description of the interface: groups, and the errors that a route may answer."""

from __future__ import annotations

from http import HTTPStatus
from typing import Annotated, Any

from fastapi import FastAPI, Path, Query
from fastapi.openapi.utils import get_openapi
from fastapi.routing import APIRoute

from dohyo.service.errors import PROBLEM
from dohyo.service.web.glossary import describe_parameters, describe_schemas
from dohyo.service.web.views import Problem

SUMMARY = "Submit driving agents, let them drive in SUMO traffic, read reproducible scores."
DESCRIPTION = """\
Submit an agent, order an evaluation, read its records, scores and replays.

* **Tokens.** `Authorization: Bearer TOKEN`; `dohyo tokens create` or an invitation gives one. Public results need none.
* **Errors** are problem documents (RFC 9457): `detail` says in one line what was expected and what came, `errors` names
  each place of a body.
* **Pages.** A list has `items` and `next`; pass `next` as `after` to get the next page.
* **Waiting.** 429 and 503 have `Retry-After` in seconds. Heavy work is a job: 202 with its `Location`.
* **Repeating.** A POST with an `Idempotency-Key` has one effect, however often it is sent.
* **Methods.** Every GET answers HEAD too. Unknown query parameters are refused with 422.
"""
TAGS = [
    {"name": "health", "description": "Whether the service lives, and whether it takes work."},
    {"name": "tokens", "description": "Who may do what."},
    {"name": "jobs", "description": "Heavy work that was ordered: followed, cancelled."},
    {"name": "networks", "description": "Roads."},
    {"name": "benchmarks", "description": "Versioned lists of scenarios."},
    {"name": "agents", "description": "Who drives: built-in agents, uploaded ONNX policies, remote agents."},
    {"name": "evaluations", "description": "One agent on one benchmark."},
    {"name": "episodes", "description": "One scenario of an evaluation: record, trajectory, replay, explanation."},
    {"name": "leaderboard", "description": "Who drives best, and how sure that is."},
    {"name": "comparison", "description": "Chosen evaluations side by side."},
    {"name": "challenges", "description": "Competitions: rules, phases, teams, invitations, final boards."},
    {"name": "metrics", "description": "Numbers of evaluations, under any rules, and of the service."},
    {"name": "workers", "description": "The wire: agents that drive through workers of their own, over HTTP."},
    {"name": "worlds", "description": "Live scenarios that several workers join, each with its own egos."},
    {"name": "webhooks", "description": "To be told when an evaluation has ended."},
]
MEANINGS = {
    400: "The request cannot be read.",
    401: "No valid token.",
    403: "The token's role, or its owner, may not do this.",
    404: "No such thing, or none that you may see.",
    405: "No such method here.",
    409: "It contradicts what is there.",
    413: "The body is too large.",
    422: "Something in the request cannot be used; the detail says what was expected.",
    429: "Past a quota or a rate limit; Retry-After says how many seconds to wait.",
    500: "A defect of the service.",
    503: "Not now; Retry-After says how many seconds to wait.",
    507: "No space is left.",
}
COMMON = (401, 422, 429, 503)

Name = Annotated[str, Path(min_length=1, max_length=100, examples=["quickstart"], description="Its name.")]
Identifier = Annotated[
    str, Path(min_length=1, max_length=40, examples=["ev-9f86d081884c7d65"], description="Its identifier.")
]
Limit = Annotated[int, Query(ge=1, le=500, description="At most so many items.")]
After = Annotated[str | None, Query(max_length=200, description="The `next` of the page before.")]


def problems(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """The errors of a route for its OpenAPI entry, those that every route has included; with a body (413) also 400."""
    reference = {"$ref": "#/components/schemas/Problem"}
    return {
        status: {
            "description": MEANINGS.get(status, HTTPStatus(status).phrase),
            "content": {PROBLEM: {"schema": reference}},
        }
        for status in sorted({*COMMON, *statuses, *([400] if 413 in statuses else [])})
    }


def operation_id(route: APIRoute) -> str:
    """The name of an operation in generated clients: that of the route's function, a verb and a resource."""
    return route.name


def describe(app: FastAPI) -> None:
    """Adds the problem document to the app's OpenAPI schema."""

    def openapi() -> dict[str, Any]:
        if not app.openapi_schema:
            document = get_openapi(
                title=app.title,
                version=app.version,
                summary=app.summary,
                description=app.description,
                servers=app.servers,
                routes=app.routes,
                tags=app.openapi_tags,
            )
            schemas = document.setdefault("components", {}).setdefault("schemas", {})
            schemas["Problem"] = Problem.model_json_schema()
            schemas.pop("HTTPValidationError", None)
            schemas.pop("ValidationError", None)
            describe_schemas(schemas)
            describe_parameters(document["paths"])
            app.openapi_schema = document
        return app.openapi_schema

    app.openapi = openapi  # type: ignore[method-assign]
