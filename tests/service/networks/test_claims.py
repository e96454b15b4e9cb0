"""Claims of network names: a job that was cancelled while it runs takes nothing from the next one."""

from __future__ import annotations

import pytest
from sqlalchemy.orm import Session

from dohyo.service.database.engine import Database
from dohyo.service.errors import ConflictError, TooManyRequestsError
from dohyo.service.jobs.model import Job, JobStatus
from dohyo.service.networks.claims import claim_name, complete, release
from dohyo.service.networks.model import UploadedNetwork


def claimed_by_another(session: Session) -> UploadedNetwork:
    """A name that Ann's job claimed before it was cancelled, and then Bob's."""
    for owner in ("ann", "bob"):
        session.add(Job(id=f"jb-{owner}", kind="network_import", owner=owner, status=JobStatus.RUNNING, arguments={}))
    session.flush()
    claim_name(session, "town", "ann", "jb-ann", most=20)
    session.get_one(Job, "jb-ann").status = JobStatus.CANCELLED
    claim_name(session, "town", "bob", "jb-bob", most=20)
    return session.get_one(UploadedNetwork, "town")


def test_a_cancelled_job_frees_no_name_of_another(database: Database) -> None:
    with database.session() as session:
        row = claimed_by_another(session)
        release(session, "town", "jb-ann")
        session.flush()
        assert session.get(UploadedNetwork, "town") is row
        release(session, "town", "jb-bob")
        session.flush()
        assert session.get(UploadedNetwork, "town") is None


def test_a_cancelled_job_completes_no_claim_of_another(database: Database) -> None:
    with database.session() as session:
        row = claimed_by_another(session)
        with pytest.raises(ConflictError, match="another one has the name"):
            complete(session, "town", "jb-ann", 10)
        assert (row.owner, row.claim) == ("bob", "jb-bob")
        complete(session, "town", "jb-bob", 10)
        assert (row.owner, row.claim, row.kept_bytes) == ("bob", None, 10)


def test_one_owner_cannot_take_all_the_room_for_networks(database: Database) -> None:
    with database.session() as session:
        for name in ("hamlet", "village"):
            claim_name(session, name, "ann", f"jb-{name}", most=2)
            complete(session, name, f"jb-{name}", 10)
        with pytest.raises(TooManyRequestsError, match="you have 2 networks"):
            claim_name(session, "town", "ann", "jb-town", most=2)
        claim_name(session, "town", "bob", "jb-town", most=2)
