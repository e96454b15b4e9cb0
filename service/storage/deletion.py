"""Deletion: of evaluations and submissions, and of record files that nothing names any more.

A ranked run is a row that nothing erases; only the files of its records may go, by retention.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from datetime import datetime

from sqlalchemy import ColumnElement, delete, select, update
from sqlalchemy.orm import Session

from dohyo.service.database.engine import Database
from dohyo.service.episodes.archive import archived_path
from dohyo.service.errors import ConflictError
from dohyo.service.evaluations.model import UNFINISHED, Attempt, Episode, Evaluation, EvaluationEgo
from dohyo.service.settings import Settings
from dohyo.service.storage.files import file_lock
from dohyo.service.submissions.model import Submission


def delete_evaluation(session: Session, evaluation: Evaluation) -> list[str]:
    """Deletes a practice run with its episodes.

    Returns:
        Hashes of records that nothing names any more; their files are removed after the transaction.

    Raises:
        ConflictError: The run is ranked, or it or a run that may make the same records has not ended.
    """
    if evaluation.ranking_id is not None:
        raise ConflictError(f"evaluation '{evaluation.id}' is ranked: ranked runs stay for ever")
    drivers = [evaluation.submission_id, *(one.submission_id for one in evaluation.egos)]
    alike = (
        _driven_by(drivers),
        Evaluation.benchmark_sha256 == evaluation.benchmark_sha256,
        Evaluation.status.in_(UNFINISHED),
    )
    if other := session.scalars(select(Evaluation.id).where(*alike).limit(1)).first():
        raise ConflictError(f"evaluation '{other}' has not ended; cancel it first, or wait")
    of_this = Episode.evaluation_id == evaluation.id
    hashes = list(session.scalars(select(Episode.record_hash).where(of_this, Episode.record_hash.is_not(None))))
    session.execute(delete(Attempt).where(Attempt.episode_id.in_(select(Episode.id).where(of_this))))
    session.execute(delete(Episode).where(of_this))
    session.delete(evaluation)
    session.flush()
    return _unnamed(session, [one for one in hashes if one is not None])


def delete_submission(session: Session, submission: Submission) -> str | None:
    """Deletes a submission that no evaluation names, a mixed run neither; its version is never given again.

    Returns:
        Hash of its policy, for `remove_policy` after the transaction; None without one.

    Raises:
        ConflictError: An evaluation names it.
    """
    used = session.scalars(select(Evaluation.id).where(_driven_by([submission.id])).limit(1)).first()
    if used is not None:
        raise ConflictError(f"evaluation '{used}' is of version {submission.version}; delete it first")
    session.delete(submission)
    return submission.policy_sha256


def _driven_by(submissions: Sequence[str]) -> ColumnElement[bool]:
    """Condition on `Evaluation`: one of the submissions drives in it, be it a single ego of a mixed run."""
    mixed = select(EvaluationEgo.evaluation_id).where(EvaluationEgo.submission_id.in_(submissions))
    return Evaluation.submission_id.in_(submissions) | Evaluation.id.in_(mixed)


def retire_records(session: Session, before: datetime) -> list[str]:
    """Marks the records of evaluations that finished before a moment as no longer kept; all rows stay.

    Returns:
        Hashes of records that no newer evaluation names.
    """
    old = select(Evaluation.id).where(Evaluation.status.not_in(UNFINISHED), Evaluation.finished < before)
    kept = (Episode.evaluation_id.in_(old), Episode.kept_bytes > 0)
    hashes = [one for one in session.scalars(select(Episode.record_hash).where(*kept)) if one is not None]
    session.execute(update(Episode).where(*kept).values(kept_bytes=0).execution_options(synchronize_session=False))
    return _unnamed(session, hashes)


def remove_records(settings: Settings, database: Database, hashes: Iterable[str]) -> None:
    """Removes the files of records that nothing names, and those derived from them."""
    for one in hashes:
        with file_lock(one):
            with database.reading() as session:
                named = not _unnamed(session, [one])
            if named:  # by an evaluation that has made the same record meanwhile
                continue
            facts = archived_path(settings, one)
            for file in (facts, *facts.parent.glob(f"{one}.*")):  # a record exists as long as its JSON file does
                file.unlink(missing_ok=True)


def remove_policy(settings: Settings, database: Database, policy_sha256: str) -> None:
    """Removes the file of a policy that no submission has."""
    with file_lock(policy_sha256):
        with database.reading() as session:
            has = select(Submission.id).where(Submission.policy_sha256 == policy_sha256).limit(1)
            named = session.scalars(has).first() is not None
        if not named:
            (settings.policies / f"{policy_sha256}.onnx").unlink(missing_ok=True)


def _unnamed(session: Session, hashes: Sequence[str]) -> list[str]:
    """Those records that no episode keeps."""
    named: set[str | None] = set()
    for begin in range(0, len(hashes), 500):
        some = hashes[begin : begin + 500]
        query = select(Episode.record_hash).where(Episode.record_hash.in_(some), Episode.kept_bytes > 0)
        named.update(session.scalars(query))
    return [one for one in dict.fromkeys(hashes) if one not in named]
