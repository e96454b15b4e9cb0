"""Guests of worlds."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "2026_11_world_guests"
down_revision = "2026_11_worlds"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Makes the change."""
    op.create_table(
        "world_guests",
        sa.Column("world_id", sa.String(length=32), nullable=False),
        sa.Column("owner", sa.String(length=100), nullable=False),
        sa.PrimaryKeyConstraint("world_id", "owner"),
    )
    op.create_index("ix_world_guests_owner", "world_guests", ["owner"])


def downgrade() -> None:
    """Takes it back."""
    op.drop_table("world_guests")
