"""Worlds."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "2026_11_worlds"
down_revision = "2026_11"
branch_labels = None
depends_on = None

MOMENT = sa.DateTime(timezone=True)


def upgrade() -> None:
    """Makes the change."""
    op.create_table(
        "worlds",
        sa.Column("id", sa.String(length=32), nullable=False),
        sa.Column("owner", sa.String(length=100), nullable=False),
        sa.Column("order", sa.JSON(), nullable=False),
        sa.Column("status", sa.String(length=20), nullable=False),
        sa.Column("created", MOMENT, nullable=False),
        sa.Column("finished", MOMENT, nullable=True),
        sa.Column("reason", sa.String(length=2000), nullable=True),
        sa.Column("tick", sa.Integer(), nullable=False),
        sa.Column("record_hash", sa.String(length=64), nullable=True),
        sa.Column("kept_bytes", sa.Integer(), nullable=False),
        sa.PrimaryKeyConstraint("id"),
    )
    op.create_index("ix_worlds_owner", "worlds", ["owner"])
    op.create_index("ix_worlds_status", "worlds", ["status"])


def downgrade() -> None:
    """Takes it back."""
    op.drop_table("worlds")
