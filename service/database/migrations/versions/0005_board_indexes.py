"""Indexes from which a board's counts are read, without the rows."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "2026_11_board_indexes"
down_revision = "2026_11_mixed_runs"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Makes the change."""
    op.create_index("by_end", "results", ["ranking_id", "finished"])
    op.drop_index("ix_results_ranking_id", "results")
    op.create_index("by_evaluation", "episodes", ["evaluation_id", "id"])
    op.drop_index("ix_episodes_evaluation_id", "episodes")
    op.create_index(
        "charged_attempts",
        "attempts",
        ["episode_id"],
        sqlite_where=sa.text("charged = 1"),
        postgresql_where=sa.text("charged"),
    )


def downgrade() -> None:
    """Takes it back."""
    op.drop_index("charged_attempts", "attempts")
    op.create_index("ix_episodes_evaluation_id", "episodes", ["evaluation_id"])
    op.drop_index("by_evaluation", "episodes")
    op.create_index("ix_results_ranking_id", "results", ["ranking_id"])
    op.drop_index("by_end", "results")
