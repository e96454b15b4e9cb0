"""The identity of the database, which the first start gives it."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "2026_16_identity"
down_revision = "2026_15_numbers_of_evaluations"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Makes the change."""
    op.create_table("identity", sa.Column("id", sa.String(length=32), nullable=False), sa.PrimaryKeyConstraint("id"))


def downgrade() -> None:
    """Takes it back."""
    op.drop_table("identity")
