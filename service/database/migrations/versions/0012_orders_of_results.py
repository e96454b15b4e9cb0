"""Results have no time of their order any more: the evaluation's number tells which run came first."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "2026_17_orders_of_results"
down_revision = "2026_16_identity"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Makes the change, which for a few hours an earlier migration made."""
    if "ordered" in {column["name"] for column in sa.inspect(op.get_bind()).get_columns("results")}:
        op.drop_column("results", "ordered")


def downgrade() -> None:
    """Takes it back."""
    op.add_column("results", sa.Column("ordered", sa.DateTime(timezone=True), nullable=True))
    results = sa.table("results", sa.column("evaluation_id"), sa.column("ordered"))
    evaluations = sa.table("evaluations", sa.column("id"), sa.column("created"))
    created = sa.select(evaluations.c.created).where(evaluations.c.id == results.c.evaluation_id).scalar_subquery()
    op.execute(results.update().values(ordered=created))
