"""An index of the evaluations that webhooks have not been told of; sizes of worlds' records of 64 bits."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "2026_18_unannounced_ends"
down_revision = "2026_17_orders_of_results"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Makes the change."""
    news = sa.text("announced IS NULL OR announced < finished")
    op.create_index("unannounced", "evaluations", ["status"], sqlite_where=news, postgresql_where=news)
    _change_kept_bytes(sa.Integer(), sa.BigInteger())


def downgrade() -> None:
    """Takes it back."""
    _change_kept_bytes(sa.BigInteger(), sa.Integer())
    op.drop_index("unannounced", "evaluations")


def _change_kept_bytes(old: sa.Integer, new: sa.Integer) -> None:
    with op.batch_alter_table("worlds") as worlds:
        worlds.alter_column("kept_bytes", existing_type=old, type_=new, existing_nullable=False)
