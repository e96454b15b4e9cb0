"""A database that refuses for a while: what was to be written is written later."""

from __future__ import annotations

import asyncio
import signal
import threading
from pathlib import Path

import pytest
import uvicorn
from sqlalchemy import text
from sqlalchemy.exc import OperationalError
from sqlalchemy.exc import TimeoutError as NoConnectionError
from sqlalchemy.orm import Session

from dohyo.service.database import patience
from dohyo.service.database.engine import Database
from dohyo.service.database.patience import PatientDatabase
from dohyo.service.server import DrainingServer
from tests.service.harness import running


@pytest.mark.parametrize("database_url", ["postgresql"], indirect=True)
def test_a_result_waits_for_a_connection_that_others_hold(database_url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(patience, "RETRY_S", (0.1,))
    database = Database(database_url, busy_s=0.2, pool=1)
    held = [database.engine.connect(), database.engine.connect()]

    def one(session: Session) -> int:
        return session.scalars(text("SELECT 1")).one()  # type: ignore[call-overload, no-any-return]

    async def main() -> int:
        patient = PatientDatabase(database)
        with pytest.raises(NoConnectionError):
            await patient.read(one, patient=False)
        threading.Timer(0.5, lambda: [connection.close() for connection in held]).start()
        return await patient.change(one)

    assert asyncio.run(main()) == 1
    database.close()


@pytest.mark.parametrize("database_url", ["postgresql"], indirect=True)
def test_a_connection_notices_that_the_network_is_gone(database: Database) -> None:
    """Otherwise a drive's result would wait for as long as the system's own time-out, which may be hours."""
    with database.engine.connect() as connection:
        driver = connection.connection.driver_connection
        assert driver is not None
        parameters = driver.info.get_parameters()
        assert (parameters["tcp_user_timeout"], parameters["keepalives_idle"]) == ("10000", "10")
        assert connection.scalar(text("SHOW tcp_keepalives_idle")) in ("10", "0")  # 0: a socket of this machine
        assert connection.scalar(text("SHOW lock_timeout")) == "5s"


def test_a_signal_during_the_start_ends_the_wait_for_a_database_that_refuses(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before, the start asked for ever, and only SIGKILL ended the service."""
    monkeypatch.setattr(patience, "RETRY_S", (0.1,))
    with running(tmp_path / "data") as service:
        services = service.services
    server = DrainingServer(uvicorn.Config(service.client.app), services)

    def refused(session: Session) -> None:
        session.execute(text("SELECT * FROM no_table"))

    async def main() -> None:
        asyncio.get_running_loop().call_later(0.3, server.handle_exit, signal.SIGTERM, None)
        with pytest.raises(OperationalError):
            await asyncio.wait_for(PatientDatabase(services.database).read(refused), 120)

    asyncio.run(main())
    assert server.should_exit
