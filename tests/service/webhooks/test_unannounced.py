"""Ends that webhooks have not been told of are looked for at every poll: the query reads them alone."""

from __future__ import annotations

from typing import Any

from sqlalchemy import event, insert
from sqlalchemy.orm import Session

from dohyo.service.database.base import now
from dohyo.service.database.engine import Database
from dohyo.service.evaluations.model import BenchmarkVersion, Evaluation, EvaluationStatus
from dohyo.service.submissions.model import Agent, Submission
from dohyo.service.webhooks.queries import unannounced

HISTORY = 1000


def add_history(session: Session) -> None:
    """Evaluations that ended and were announced, and one that ended a moment ago."""
    session.add_all([Agent(id="a", name="a", owner="o"), BenchmarkVersion(sha256="b", name="b", document={})])
    session.flush()
    session.add(Submission(id="s", agent_id="a", version=1, kind="builtin", track="map", info={}))
    session.flush()
    same = {"owner": "o", "submission_id": "s", "benchmark_sha256": "b", "seeds": [0], "act_deadline_s": 1.0}
    end = {"status": EvaluationStatus.DONE, "finished": now()}
    rows = [{"id": f"ev-{i}", "number": i, "announced": end["finished"], **same, **end} for i in range(HISTORY)]
    session.execute(insert(Evaluation), [*rows, {"id": "new", "number": HISTORY, "announced": None, **same, **end}])


def plan_of(database: Database, session: Session, statement: str, parameters: Any) -> str:
    """How the database answers a query, when it knows the size of its tables."""
    connection = session.connection()
    connection.exec_driver_sql("ANALYZE")
    explain = "EXPLAIN QUERY PLAN " if database.is_sqlite else "EXPLAIN "
    return "\n".join(str(tuple(row)) for row in connection.exec_driver_sql(explain + statement, parameters))


def test_the_history_is_not_read_to_find_what_is_new(database: Database) -> None:
    asked: list[tuple[str, Any]] = []
    with database.session() as session:
        add_history(session)
    with database.session() as session:
        event.listen(database.engine, "before_cursor_execute", lambda *given: asked.append((given[2], given[3])))
        assert [one.id for one in unannounced(session)] == ["new"]
        (query,) = [one for one in asked if "FROM evaluations" in one[0]]
        plan = plan_of(database, session, *query)
    assert "unannounced" in plan
    assert "SCAN evaluations" not in plan
    assert "Seq Scan on evaluations" not in plan
    assert "ix_evaluations_status" not in plan
