"""Egos of mixed runs."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "2026_11_mixed_runs"
down_revision = "2026_11_world_guests"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Makes the change."""
    op.create_table(
        "evaluation_egos",
        sa.Column("evaluation_id", sa.String(length=32), nullable=False),
        sa.Column("ego", sa.String(length=100), nullable=False),
        sa.Column("submission_id", sa.String(length=32), nullable=False),
        sa.ForeignKeyConstraint(["evaluation_id"], ["evaluations.id"]),
        sa.ForeignKeyConstraint(["submission_id"], ["submissions.id"]),
        sa.PrimaryKeyConstraint("evaluation_id", "ego"),
    )
    op.create_index("ix_evaluation_egos_submission_id", "evaluation_egos", ["submission_id"])


def downgrade() -> None:
    """Takes it back."""
    op.drop_table("evaluation_egos")
