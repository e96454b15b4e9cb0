"""Results hold a value per episode, which were per ego; without any they are computed again when a board is read."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "2026_13_values_of_episodes"
down_revision = "2026_12_dohyo_versions"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Makes the change."""
    op.execute(sa.table("results").delete())


def downgrade() -> None:
    """Takes it back."""
    op.execute(sa.table("results").delete())
