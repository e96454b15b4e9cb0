"""Numbers of evaluations, which grow with each order, whatever the clock says; those of before follow their times."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "2026_15_numbers_of_evaluations"
down_revision = "2026_14_admission_of_guests"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Makes the change."""
    op.add_column("evaluations", sa.Column("number", sa.Integer(), nullable=True))
    evaluations = sa.table("evaluations", sa.column("id"), sa.column("created"), sa.column("number"))
    connection = op.get_bind()
    ordered = connection.scalars(sa.select(evaluations.c.id).order_by(evaluations.c.created, evaluations.c.id)).all()
    if ordered:
        one = evaluations.update().where(evaluations.c.id == sa.bindparam("which")).values(number=sa.bindparam("its"))
        connection.execute(one, [{"which": which, "its": its} for its, which in enumerate(ordered, 1)])
    op.create_index("ix_evaluations_number", "evaluations", ["number"])


def downgrade() -> None:
    """Takes it back."""
    op.drop_index("ix_evaluations_number", "evaluations")
    op.drop_column("evaluations", "number")
