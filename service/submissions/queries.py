"""Agents and their submissions."""

from __future__ import annotations

from collections.abc import Sequence

from sqlalchemy import and_, func, select
from sqlalchemy.orm import Session

from dohyo.evaluation.records.record import AgentInfo
from dohyo.service.database.base import new_id
from dohyo.service.database.engine import serialise
from dohyo.service.submissions.model import Agent, AgentKind, Submission


def find_agent(session: Session, name: str) -> Agent | None:
    """An agent by its name."""
    return session.scalar(select(Agent).where(Agent.name == name))


def find_like(session: Session, name: str) -> Agent | None:
    """An agent of the same name; case does not matter, so that no agent can be taken for another."""
    return session.scalar(select(Agent).where(func.lower(Agent.name) == name.lower()).limit(1))


def count_agents(session: Session, owner: str) -> int:
    """Number of an owner's agents."""
    return session.scalar(select(func.count()).select_from(Agent).where(Agent.owner == owner)) or 0


def add_agent(session: Session, name: str, owner: str, description: str) -> Agent:
    """Registers an agent."""
    agent = Agent(id=new_id("ag"), name=name, owner=owner, description=description)
    session.add(agent)
    session.flush()
    return agent


def list_agents(
    session: Session, owner: str | None = None, limit: int | None = None, after: str | None = None
) -> Sequence[tuple[Agent, Submission | None]]:
    """Agents by name, those past `after`, each with its latest submission.

    Args:
        session: To read in.
        owner: Only agents of this owner; None: of all owners.
        limit: Largest number of results.
        after: Name after which the results begin.
    """
    latest = select(Submission.agent_id, func.max(Submission.version).label("version")).group_by(Submission.agent_id)
    newest = latest.subquery()
    query = (
        select(Agent, Submission)
        .outerjoin(newest, newest.c.agent_id == Agent.id)
        .outerjoin(Submission, and_(Submission.agent_id == Agent.id, Submission.version == newest.c.version))
        .order_by(Agent.name)
        .limit(limit)
    )
    if owner is not None:
        query = query.where(Agent.owner == owner)
    if after is not None:
        query = query.where(Agent.name > after)
    return [(agent, submission) for agent, submission in session.execute(query).unique()]


def find_submission(session: Session, agent: Agent, version: int | None = None) -> Submission | None:
    """A submission of an agent by its version; the latest without one."""
    query = select(Submission).where(Submission.agent_id == agent.id).order_by(Submission.version.desc())
    if version is not None:
        query = query.where(Submission.version == version)
    return session.scalars(query.limit(1)).first()


def list_submissions(
    session: Session, agent: Agent, limit: int | None = None, after: int | None = None
) -> Sequence[Submission]:
    """Submissions of an agent, the newest first, those before version `after`."""
    query = select(Submission).where(Submission.agent_id == agent.id).order_by(Submission.version.desc()).limit(limit)
    return session.scalars(query.where(Submission.version < after) if after is not None else query).all()


def count_submissions(session: Session, agent: Agent) -> int:
    """Number of an agent's submissions."""
    return session.scalar(select(func.count()).select_from(Submission).where(Submission.agent_id == agent.id)) or 0


def add_submission(
    session: Session,
    agent: Agent,
    kind: AgentKind,
    info: AgentInfo,
    policy_sha256: str | None = None,
    *,
    identifier: str | None = None,
    kept_bytes: int = 0,
) -> Submission:
    """Adds the next version of an agent, under a new identifier unless one is given."""
    serialise(session)
    session.refresh(agent)
    last = session.scalar(select(func.max(Submission.version)).where(Submission.agent_id == agent.id)) or 0
    agent.newest = max(agent.newest, last) + 1
    submission = Submission(
        id=identifier or new_id("sub"),
        agent_id=agent.id,
        version=agent.newest,
        kind=kind,
        track=info.track,
        info=info.model_dump(mode="json"),
        policy_sha256=policy_sha256,
        kept_bytes=kept_bytes,
    )
    session.add(submission)
    session.flush()
    return submission
