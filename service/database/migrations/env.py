"""Alembic's environment: migrations run on the connection that `Database.migrate` gives, in its transaction."""

from __future__ import annotations

from alembic import context
from sqlalchemy import Connection

from dohyo.service.database.engine import Database
from dohyo.service.database.tables import METADATA
from dohyo.service.settings import Settings


def run(connection: Connection) -> None:
    """Runs what the command asks for."""
    # SQLite alters tables by making them anew.
    context.configure(
        connection=connection,
        target_metadata=METADATA,
        render_as_batch=connection.dialect.name == "sqlite",
        compare_type=True,
        transactional_ddl=True,
    )
    with context.begin_transaction():
        context.run_migrations()


given: Connection | None = context.config.attributes.get("connection")
if given is not None:
    run(given)
else:
    with Database(Settings().database_url).engine.begin() as own:
        run(own)
