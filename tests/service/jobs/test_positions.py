"""Positions of queued jobs: of a whole list by one query."""

from __future__ import annotations

from datetime import timedelta

from sqlalchemy import event

from dohyo.service.database.base import now
from dohyo.service.database.engine import Database
from dohyo.service.jobs.model import Job, JobStatus
from dohyo.service.jobs.queries import count_ahead, list_jobs


def test_jobs_are_counted_that_wait_before_each_by_one_query(database: Database) -> None:
    began, queued, asked = now(), JobStatus.QUEUED, list[str]()
    jobs = (("ann", queued), ("bob", JobStatus.RUNNING), ("bob", queued), ("ann", JobStatus.DONE), ("ann", queued))
    with database.session() as session:
        for second, (owner, status) in enumerate(jobs):
            created = began + timedelta(seconds=second // 2 * 2)  # of equal times the identifier decides
            one = Job(id=f"job-{second}", kind="k", owner=owner, status=status, arguments={}, created=created)
            session.add(one)
    event.listen(database.engine, "before_cursor_execute", lambda *given: asked.append(given[2]))
    with database.reading() as session:
        mine = list_jobs(session, "ann")
        before = len(asked)
        assert count_ahead(session, mine) == {"job-0": 0, "job-4": 2}
        assert len(asked) == before + 1
        assert count_ahead(session, [one for one in mine if one.status is JobStatus.DONE]) == {}
        assert len(asked) == before + 1
