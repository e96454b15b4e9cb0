"""All tables, imported where a database is made or changed as a whole."""

from __future__ import annotations

from dohyo.service.accounts import model as accounts
from dohyo.service.boards import model as boards
from dohyo.service.challenges import model as challenges
from dohyo.service.database import idempotency, identity, server_lock
from dohyo.service.database.base import Base
from dohyo.service.evaluations import model as evaluations
from dohyo.service.jobs import model as jobs
from dohyo.service.networks import model as networks
from dohyo.service.submissions import model as submissions
from dohyo.service.webhooks import model as webhooks
from dohyo.service.worlds import model as worlds

MODELS = (
    accounts,
    submissions,
    evaluations,
    boards,
    challenges,
    jobs,
    networks,
    webhooks,
    worlds,
    idempotency,
    identity,
    server_lock,
)
METADATA = Base.metadata
