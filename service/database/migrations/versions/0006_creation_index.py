"""An index by which the list of evaluations begins with the newest one."""

from __future__ import annotations

from alembic import op

revision = "2026_11_creation_index"
down_revision = "2026_11_board_indexes"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Makes the change."""
    op.create_index("by_creation", "evaluations", ["created", "id"])


def downgrade() -> None:
    """Takes it back."""
    op.drop_index("by_creation", "evaluations")
