from __future__ import annotations

from datetime import timedelta

from sqlalchemy import select, text

from dohyo.service.accounts.model import Role
from dohyo.service.accounts.queries import create_token, find_token, first_admin_token, revoke_token
from dohyo.service.database.base import now
from dohyo.service.database.engine import Database


def test_the_secret_is_nowhere_in_the_database(database: Database) -> None:
    with database.session() as session:
        _, secret = create_token(session, "team", Role.SUBMITTER)
    with database.reading() as session:
        rows = session.execute(text("SELECT * FROM tokens")).all()
    assert len(rows) == 1
    assert secret not in str(rows)
    assert secret.removeprefix("dohyo_") not in str(rows)


def test_a_token_is_found_by_its_secret_alone(database: Database) -> None:
    with database.session() as session:
        token, secret = create_token(session, "team", Role.WORKER)
        create_token(session, "other", Role.ADMIN)
    with database.reading() as session:
        found = find_token(session, secret)
        assert found is not None
        assert (found.id, found.owner, found.role) == (token.id, "team", Role.WORKER)
        for wrong in ("", secret[:-1], secret + "a", secret.upper(), token.id, token.sha256, "\udcff", "é" * 50):
            assert find_token(session, wrong) is None


def test_it_ends_at_its_expiry_and_not_before(database: Database) -> None:
    with database.session() as session:
        token, secret = create_token(session, "team", Role.WORKER, timedelta(days=2))
    assert token.expires is not None
    with database.reading() as session:
        assert find_token(session, secret, at=token.expires - timedelta(seconds=1)) is not None
        assert find_token(session, secret, at=token.expires) is None
        assert find_token(session, secret, at=now() + timedelta(days=3)) is None


def test_revoked_is_revoked_and_stays_so(database: Database) -> None:
    with database.session() as session:
        token, secret = create_token(session, "team", Role.WORKER)
    with database.session() as session:
        revoked = revoke_token(session, token.id)
        assert revoked is not None
        moment = revoked.revoked
    with database.session() as session:
        assert find_token(session, secret) is None
        again = revoke_token(session, token.id)
        assert again is not None
        assert again.revoked == moment
        assert revoke_token(session, "tok-nobody") is None


def test_the_first_administrator_is_made_once(database: Database) -> None:
    with database.session() as session:
        first = first_admin_token(session)
    assert first is not None
    with database.session() as session:
        assert first_admin_token(session) is None
        token = find_token(session, first)
        assert token is not None
        assert token.role is Role.ADMIN
    with database.session() as session:
        revoke_token(session, token.id)
    with database.session() as session:
        # A revoked one counts too: a restart of the service gives no new rights.
        assert first_admin_token(session) is None


def test_roles_are_stored_as_words(database: Database) -> None:
    with database.session() as session:
        create_token(session, "team", Role.SUBMITTER)
    with database.reading() as session:
        assert session.execute(select(text("role")).select_from(text("tokens"))).scalar() == "submitter"
