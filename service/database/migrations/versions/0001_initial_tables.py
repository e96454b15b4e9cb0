"""Initial tables."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "2026_11"
down_revision = None
branch_labels = None
depends_on = None

MOMENT = sa.DateTime(timezone=True)


def upgrade() -> None:
    """Makes the change."""
    op.create_table(
        "agents",
        sa.Column("id", sa.String(length=32), nullable=False),
        sa.Column("name", sa.String(length=100), nullable=False),
        sa.Column("owner", sa.String(length=100), nullable=False),
        sa.Column("description", sa.String(length=2000), nullable=False),
        sa.Column("newest", sa.Integer(), nullable=False),
        sa.Column("created", MOMENT, nullable=False),
        sa.PrimaryKeyConstraint("id"),
        sa.UniqueConstraint("name"),
    )
    op.create_index("ix_agents_owner", "agents", ["owner"])

    op.create_table(
        "benchmarks",
        sa.Column("sha256", sa.String(length=64), nullable=False),
        sa.Column("name", sa.String(length=100), nullable=False),
        sa.Column("document", sa.JSON(), nullable=False),
        sa.Column("created", MOMENT, nullable=False),
        sa.PrimaryKeyConstraint("sha256"),
    )
    op.create_index("ix_benchmarks_name", "benchmarks", ["name"])

    op.create_table(
        "idempotency",
        sa.Column("owner", sa.String(length=100), nullable=False),
        sa.Column("key", sa.String(length=200), nullable=False),
        sa.Column("request_sha256", sa.String(length=64), nullable=False),
        sa.Column("made", sa.String(length=32), nullable=False),
        sa.Column("created", MOMENT, nullable=False),
        sa.PrimaryKeyConstraint("owner", "key"),
    )
    op.create_index("ix_idempotency_created", "idempotency", ["created"])

    op.create_table(
        "tokens",
        sa.Column("id", sa.String(length=32), nullable=False),
        sa.Column("owner", sa.String(length=100), nullable=False),
        sa.Column(
            "role",
            sa.Enum("admin", "organiser", "submitter", "worker", "reader", name="role", native_enum=False, length=20),
            nullable=False,
        ),
        sa.Column("sha256", sa.String(length=64), nullable=False),
        sa.Column("created", MOMENT, nullable=False),
        sa.Column("expires", MOMENT, nullable=True),
        sa.Column("revoked", MOMENT, nullable=True),
        sa.PrimaryKeyConstraint("id"),
        sa.UniqueConstraint("sha256"),
    )
    op.create_index("ix_tokens_owner", "tokens", ["owner"])

    op.create_table(
        "webhooks",
        sa.Column("id", sa.String(length=32), nullable=False),
        sa.Column("owner", sa.String(length=100), nullable=False),
        sa.Column("url", sa.String(length=2000), nullable=False),
        sa.Column("secret", sa.String(length=100), nullable=False),
        sa.Column("created", MOMENT, nullable=False),
        sa.PrimaryKeyConstraint("id"),
    )
    op.create_index("ix_webhooks_owner", "webhooks", ["owner"])

    op.create_table(
        "deliveries",
        sa.Column("id", sa.String(length=32), nullable=False),
        sa.Column("webhook_id", sa.String(length=32), nullable=False),
        sa.Column("body", sa.JSON(), nullable=False),
        sa.Column("attempts", sa.Integer(), nullable=False),
        sa.Column("due", MOMENT, nullable=False),
        sa.Column("delivered", MOMENT, nullable=True),
        sa.Column("failure", sa.String(length=500), nullable=True),
        sa.ForeignKeyConstraint(["webhook_id"], ["webhooks.id"], ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("id"),
    )
    op.create_index("ix_deliveries_due", "deliveries", ["due"])
    op.create_index("ix_deliveries_webhook_id", "deliveries", ["webhook_id"])

    op.create_table(
        "networks",
        sa.Column("name", sa.String(length=63), nullable=False),
        sa.Column("owner", sa.String(length=100), nullable=False),
        sa.Column("kept_bytes", sa.BigInteger(), nullable=False),
        sa.Column("claim", sa.String(length=40), nullable=True),
        sa.Column("created", MOMENT, nullable=False),
        sa.PrimaryKeyConstraint("name"),
    )
    op.create_index("ix_networks_owner", "networks", ["owner"])

    op.create_table(
        "jobs",
        sa.Column("id", sa.String(length=32), nullable=False),
        sa.Column("kind", sa.String(length=40), nullable=False),
        sa.Column("owner", sa.String(length=100), nullable=False),
        sa.Column(
            "status",
            sa.Enum("queued", "running", "done", "failed", "cancelled", name="jobstatus", native_enum=False, length=20),
            nullable=False,
        ),
        sa.Column("arguments", sa.JSON(), nullable=False),
        sa.Column("subject", sa.String(length=100), nullable=True),
        sa.Column("upload_bytes", sa.BigInteger(), nullable=False),
        sa.Column("starts", sa.Integer(), nullable=False),
        sa.Column("result", sa.String(length=400), nullable=True),
        sa.Column("answer", sa.JSON(), nullable=True),
        sa.Column("problem", sa.JSON(), nullable=True),
        sa.Column("created", MOMENT, nullable=False),
        sa.Column("started", MOMENT, nullable=True),
        sa.Column("finished", MOMENT, nullable=True),
        sa.PrimaryKeyConstraint("id"),
    )
    op.create_index("ix_jobs_subject", "jobs", ["subject"])
    op.create_index("jobs_by_owner", "jobs", ["owner", "status"])
    op.create_index("jobs_by_status", "jobs", ["status", "created"])

    op.create_table(
        "submissions",
        sa.Column("id", sa.String(length=32), nullable=False),
        sa.Column("agent_id", sa.String(length=32), nullable=False),
        sa.Column("version", sa.Integer(), nullable=False),
        sa.Column(
            "kind", sa.Enum("builtin", "onnx", "remote", name="agentkind", native_enum=False, length=20), nullable=False
        ),
        sa.Column("track", sa.String(length=20), nullable=False),
        sa.Column("info", sa.JSON(), nullable=False),
        sa.Column("policy_sha256", sa.String(length=64), nullable=True),
        sa.Column("kept_bytes", sa.BigInteger(), nullable=False),
        sa.Column("created", MOMENT, nullable=False),
        sa.ForeignKeyConstraint(["agent_id"], ["agents.id"]),
        sa.PrimaryKeyConstraint("id"),
        sa.UniqueConstraint("agent_id", "version"),
    )
    op.create_index("ix_submissions_agent_id", "submissions", ["agent_id"])
    op.create_index("ix_submissions_track", "submissions", ["track"])

    op.create_table(
        "challenges",
        sa.Column("id", sa.String(length=32), nullable=False),
        sa.Column("name", sa.String(length=100), nullable=False),
        sa.Column("owner", sa.String(length=100), nullable=False),
        sa.Column("title", sa.String(length=200), nullable=False),
        sa.Column("rules", sa.Text(), nullable=False),
        sa.Column("created", MOMENT, nullable=False),
        sa.PrimaryKeyConstraint("id"),
        sa.UniqueConstraint("name"),
    )
    op.create_index("ix_challenges_owner", "challenges", ["owner"])

    op.create_table(
        "teams",
        sa.Column("id", sa.String(length=32), nullable=False),
        sa.Column("challenge_id", sa.String(length=32), nullable=False),
        sa.Column("name", sa.String(length=100), nullable=False),
        sa.Column("created", MOMENT, nullable=False),
        sa.ForeignKeyConstraint(["challenge_id"], ["challenges.id"]),
        sa.PrimaryKeyConstraint("id"),
        sa.UniqueConstraint("challenge_id", "name"),
    )
    op.create_index("ix_teams_challenge_id", "teams", ["challenge_id"])

    op.create_table(
        "members",
        sa.Column("challenge_id", sa.String(length=32), nullable=False),
        sa.Column("owner", sa.String(length=100), nullable=False),
        sa.Column("team_id", sa.String(length=32), nullable=False),
        sa.Column("joined", MOMENT, nullable=False),
        sa.ForeignKeyConstraint(["challenge_id"], ["challenges.id"]),
        sa.ForeignKeyConstraint(["team_id"], ["teams.id"]),
        sa.PrimaryKeyConstraint("challenge_id", "owner"),
    )
    op.create_index("ix_members_owner", "members", ["owner"])
    op.create_index("ix_members_team_id", "members", ["team_id"])

    op.create_table(
        "invitations",
        sa.Column("id", sa.String(length=32), nullable=False),
        sa.Column("challenge_id", sa.String(length=32), nullable=False),
        sa.Column("sha256", sa.String(length=64), nullable=False),
        sa.Column("team", sa.String(length=100), nullable=True),
        sa.Column("note", sa.String(length=200), nullable=False),
        sa.Column("created", MOMENT, nullable=False),
        sa.Column("expires", MOMENT, nullable=False),
        sa.Column("revoked", MOMENT, nullable=True),
        sa.Column("redeemed", MOMENT, nullable=True),
        sa.Column("redeemed_by", sa.String(length=100), nullable=True),
        sa.ForeignKeyConstraint(["challenge_id"], ["challenges.id"]),
        sa.PrimaryKeyConstraint("id"),
        sa.UniqueConstraint("sha256"),
    )
    op.create_index("ix_invitations_challenge_id", "invitations", ["challenge_id"])

    op.create_table(
        "baselines",
        sa.Column("challenge_id", sa.String(length=32), nullable=False),
        sa.Column("submission_id", sa.String(length=32), nullable=False),
        sa.Column("created", MOMENT, nullable=False),
        sa.ForeignKeyConstraint(["challenge_id"], ["challenges.id"]),
        sa.ForeignKeyConstraint(["submission_id"], ["submissions.id"]),
        sa.PrimaryKeyConstraint("challenge_id", "submission_id"),
    )

    audience = sa.Enum("public", "participants", "organisers", name="audience", native_enum=False, length=20)
    op.create_table(
        "rankings",
        sa.Column("id", sa.String(length=32), nullable=False),
        sa.Column("challenge_id", sa.String(length=32), nullable=True),
        sa.Column("name", sa.String(length=100), nullable=False),
        sa.Column("benchmark_sha256", sa.String(length=64), nullable=False),
        sa.Column("seeds", sa.JSON(), nullable=False),
        sa.Column("secret", sa.Boolean(), nullable=False),
        sa.Column("act_deadline_s", sa.Double(), nullable=False),
        sa.Column("slow_policy", sa.String(length=10), nullable=False),
        sa.Column("track", sa.String(length=20), nullable=True),
        sa.Column("verified_only", sa.Boolean(), nullable=False),
        sa.Column("runs_per_period", sa.Integer(), nullable=False),
        sa.Column("period_s", sa.Double(), nullable=False),
        sa.Column("counts", sa.Enum("best", "first", name="counts", native_enum=False, length=20), nullable=False),
        sa.Column("opens", MOMENT, nullable=True),
        sa.Column("closes", MOMENT, nullable=True),
        sa.Column("ends", MOMENT, nullable=True),
        sa.Column("board", audience, nullable=False),
        sa.Column("replays", audience, nullable=False),
        sa.Column("records", audience, nullable=False),
        sa.Column("final", sa.JSON(), nullable=True),
        sa.Column("finalised", MOMENT, nullable=True),
        sa.Column("created", MOMENT, nullable=False),
        sa.ForeignKeyConstraint(["benchmark_sha256"], ["benchmarks.sha256"]),
        sa.ForeignKeyConstraint(["challenge_id"], ["challenges.id"]),
        sa.PrimaryKeyConstraint("id"),
        sa.UniqueConstraint("challenge_id", "name"),
    )
    op.create_index("ix_rankings_benchmark_sha256", "rankings", ["benchmark_sha256"])
    op.create_index("ix_rankings_challenge_id", "rankings", ["challenge_id"])
    op.create_index("ix_rankings_ends", "rankings", ["ends"])

    op.create_table(
        "evaluations",
        sa.Column("id", sa.String(length=32), nullable=False),
        sa.Column("owner", sa.String(length=100), nullable=False),
        sa.Column("submission_id", sa.String(length=32), nullable=False),
        sa.Column("benchmark_sha256", sa.String(length=64), nullable=False),
        sa.Column("ranking_id", sa.String(length=32), nullable=True),
        sa.Column("team_id", sa.String(length=32), nullable=True),
        sa.Column("seeds", sa.JSON(), nullable=False),
        sa.Column(
            "status",
            sa.Enum(
                "queued",
                "running",
                "done",
                "failed",
                "cancelled",
                name="evaluationstatus",
                native_enum=False,
                length=20,
            ),
            nullable=False,
        ),
        sa.Column("slow_policy", sa.String(length=10), nullable=False),
        sa.Column("act_deadline_s", sa.Double(), nullable=False),
        sa.Column("failure", sa.String(length=2000), nullable=True),
        sa.Column("created", MOMENT, nullable=False),
        sa.Column("started", MOMENT, nullable=True),
        sa.Column("finished", MOMENT, nullable=True),
        sa.Column("announced", MOMENT, nullable=True),
        sa.Column("agent_secret", sa.String(length=64), nullable=False),
        sa.ForeignKeyConstraint(["benchmark_sha256"], ["benchmarks.sha256"]),
        sa.ForeignKeyConstraint(["ranking_id"], ["rankings.id"]),
        sa.ForeignKeyConstraint(["submission_id"], ["submissions.id"]),
        sa.ForeignKeyConstraint(["team_id"], ["teams.id"]),
        sa.PrimaryKeyConstraint("id"),
    )
    op.create_index("by_ranking", "evaluations", ["ranking_id", "status"])
    op.create_index("ix_evaluations_team_id", "evaluations", ["team_id"])
    op.create_index("ix_evaluations_benchmark_sha256", "evaluations", ["benchmark_sha256"])
    op.create_index("ix_evaluations_owner", "evaluations", ["owner"])
    op.create_index("ix_evaluations_status", "evaluations", ["status"])
    op.create_index("ix_evaluations_submission_id", "evaluations", ["submission_id"])

    op.create_table(
        "episodes",
        sa.Column("id", sa.String(length=32), nullable=False),
        sa.Column("evaluation_id", sa.String(length=32), nullable=False),
        sa.Column("position", sa.Integer(), nullable=False),
        sa.Column("scenario", sa.String(length=220), nullable=False),
        sa.Column("cell", sa.String(length=100), nullable=False),
        sa.Column("seed", sa.Integer(), nullable=False),
        sa.Column(
            "status",
            sa.Enum(
                "queued", "running", "done", "lost", "cancelled", name="episodestatus", native_enum=False, length=20
            ),
            nullable=False,
        ),
        sa.Column("attempts", sa.Integer(), nullable=False),
        sa.Column("record_hash", sa.String(length=64), nullable=True),
        sa.Column("kept_bytes", sa.BigInteger(), nullable=False),
        sa.Column("summary", sa.JSON(), nullable=True),
        sa.Column("failure", sa.String(length=2000), nullable=True),
        sa.Column("started", MOMENT, nullable=True),
        sa.Column("finished", MOMENT, nullable=True),
        sa.ForeignKeyConstraint(["evaluation_id"], ["evaluations.id"]),
        sa.PrimaryKeyConstraint("id"),
        sa.UniqueConstraint("evaluation_id", "position"),
    )
    op.create_index("by_status", "episodes", ["evaluation_id", "status"])
    op.create_index("ix_episodes_evaluation_id", "episodes", ["evaluation_id"])
    op.create_index("ix_episodes_record_hash", "episodes", ["record_hash"])

    op.create_table(
        "servers",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("host", sa.String(length=255), nullable=False),
        sa.Column("process", sa.Integer(), nullable=False),
        sa.Column("started", MOMENT, nullable=False),
        sa.PrimaryKeyConstraint("id"),
    )

    op.create_table(
        "attempts",
        sa.Column("id", sa.String(length=32), nullable=False),
        sa.Column("episode_id", sa.String(length=32), nullable=False),
        sa.Column("number", sa.Integer(), nullable=False),
        sa.Column("started", MOMENT, nullable=False),
        sa.Column("ended", MOMENT, nullable=True),
        sa.Column(
            "outcome",
            sa.Enum(
                "done",
                "agent_failed",
                "worker_gone",
                "given_back",
                "machine",
                "simulation",
                "unclaimed",
                "drained",
                "cancelled",
                name="attemptoutcome",
                native_enum=False,
                length=20,
            ),
            nullable=True,
        ),
        sa.Column("why", sa.String(length=2000), nullable=True),
        sa.Column("charged", sa.Boolean(), nullable=False),
        sa.Column("processor_s", sa.Double(), nullable=False),
        sa.ForeignKeyConstraint(["episode_id"], ["episodes.id"]),
        sa.PrimaryKeyConstraint("id"),
        sa.UniqueConstraint("episode_id", "number"),
    )
    op.create_index("ix_attempts_episode_id", "attempts", ["episode_id"])

    op.create_table(
        "results",
        sa.Column("evaluation_id", sa.String(length=32), nullable=False),
        sa.Column("ranking_id", sa.String(length=32), nullable=False),
        sa.Column("entrant", sa.String(length=32), nullable=False),
        sa.Column("track", sa.String(length=20), nullable=False),
        sa.Column("score", sa.Double(), nullable=False),
        sa.Column("ordered", MOMENT, nullable=False),
        sa.Column("finished", MOMENT, nullable=False),
        sa.Column("facts", sa.JSON(), nullable=False),
        sa.ForeignKeyConstraint(["evaluation_id"], ["evaluations.id"], ondelete="CASCADE"),
        sa.ForeignKeyConstraint(["ranking_id"], ["rankings.id"]),
        sa.PrimaryKeyConstraint("evaluation_id"),
    )
    op.create_index("ix_results_ranking_id", "results", ["ranking_id"])


def downgrade() -> None:
    """Takes it back."""
    for table in (
        "servers",
        "attempts",
        "results",
        "episodes",
        "evaluations",
        "rankings",
        "baselines",
        "invitations",
        "members",
        "teams",
        "challenges",
        "submissions",
        "jobs",
        "networks",
        "deliveries",
        "webhooks",
        "tokens",
        "idempotency",
        "benchmarks",
        "agents",
    ):
        op.drop_table(table)
