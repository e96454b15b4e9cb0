"""Times at which guests of worlds were admitted; those of before are not known."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "2026_14_admission_of_guests"
down_revision = "2026_13_values_of_episodes"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Makes the change."""
    op.add_column("world_guests", sa.Column("admitted", sa.DateTime(timezone=True), nullable=True))


def downgrade() -> None:
    """Takes it back."""
    op.drop_column("world_guests", "admitted")
