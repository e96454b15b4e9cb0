"""Versions of dohyo that drove mixed runs, as SQLite and PostgreSQL tell them."""

from __future__ import annotations

from pathlib import Path

from pydantic import SecretStr
from sqlalchemy import true

from dohyo.service.boards.queries import mixed_runs, mixed_runs_by_version
from dohyo.service.evaluations.model import Evaluation, EvaluationEgo, EvaluationStatus
from tests.service.served import STEADY, Service, info_of, short


def test_runs_are_found_by_the_one_version_that_drove_them(tmp_path: Path, database_url: str) -> None:
    shop = Service(tmp_path, database=SecretStr(database_url))
    driven = [["0.1.0"], ["0.10.0"], ["0.1.0", "0.10.0"], ["0.1.0"], []]
    runs = [shop.submit(info_of(STEADY), short(1), owner=f"owner-{number}") for number in range(len(driven))]
    with shop.database.session() as session:
        for identifier, versions in zip(runs, driven, strict=True):
            run = session.get_one(Evaluation, identifier)
            run.status, run.dohyo_versions = EvaluationStatus.DONE, versions
            session.add(EvaluationEgo(evaluation_id=run.id, ego="ego", submission_id=run.submission_id))
        benchmark = run.benchmark_sha256
    with shop.database.reading() as session:
        assert mixed_runs_by_version(session, benchmark, true()) == {"0.1.0": 2, "0.10.0": 1, None: 2}
        assert set(mixed_runs(session, benchmark, "0.1.0", true(), 9)) == {runs[0], runs[3]}
        assert mixed_runs(session, benchmark, "0.10.0", true(), 9) == [runs[1]]
        assert mixed_runs(session, benchmark, None, true(), 9) == []
    shop.close()
