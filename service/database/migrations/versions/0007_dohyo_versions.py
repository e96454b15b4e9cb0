"""Versions of dohyo that drove each evaluation; those of before are not known, and differ from the current one."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "2026_12_dohyo_versions"
down_revision = "2026_11_creation_index"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Makes the change."""
    op.add_column("evaluations", sa.Column("dohyo_versions", sa.JSON(), nullable=True))
    evaluations = sa.table("evaluations", sa.column("id"), sa.column("dohyo_versions", sa.JSON()))
    episodes = sa.table("episodes", sa.column("evaluation_id"), sa.column("status"))
    driven = sa.select(episodes.c.evaluation_id).where(episodes.c.status == "done")
    op.execute(evaluations.update().values(dohyo_versions=[]))
    op.execute(evaluations.update().where(evaluations.c.id.in_(driven)).values(dohyo_versions=["earlier"]))


def downgrade() -> None:
    """Takes it back."""
    op.drop_column("evaluations", "dohyo_versions")
