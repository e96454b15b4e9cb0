"""Backup and restore as docs/organisers/hosting.md says, of a service that runs, on both databases."""

from __future__ import annotations

import shutil
import sqlite3
import subprocess
from pathlib import Path

import pytest
from pydantic import SecretStr

from tests.service import postgres
from tests.service.harness import Caller, Harness, running

FILES = ("records", "policies", "networks", "signing-key.pem")


def fill(service: Harness) -> tuple[str, str]:
    """An agent and an evaluation; returns a token and the evaluation."""
    team = service.caller("team")
    team.agent("kept")
    (service.services.settings.records / "ab").mkdir()
    (service.services.settings.records / "ab" / "record.json").write_text("{}")
    return team.headers["authorization"].removeprefix("Bearer "), team.evaluation("kept")


def copy_files(data: Path, backup: Path) -> None:
    for name in FILES:
        if (data / name).is_dir():
            shutil.copytree(data / name, backup / name)
        elif (data / name).exists():
            shutil.copy2(data / name, backup / name)


def check(service: Harness, token: str, evaluation: str) -> None:
    team = Caller(service.client, token)
    assert team.get(f"/v1/evaluations/{evaluation}").json()["agent"] == "kept"
    assert (service.services.settings.records / "ab" / "record.json").is_file()
    assert team.get("/health/ready").status_code == 200


def test_sqlite(tmp_path: Path) -> None:
    data, backup = tmp_path / "data", tmp_path / "backup"
    backup.mkdir()
    with running(data) as service:
        token, evaluation = fill(service)
        with sqlite3.connect(data / "dohyo.db") as connection:
            connection.execute(f"VACUUM INTO '{backup / 'dohyo.db'}'")
        copy_files(data, backup)
    shutil.rmtree(data)
    with running(backup) as restored:
        check(restored, token, evaluation)


def test_postgresql(tmp_path: Path, postgres_server: str) -> None:
    programs = postgres.binaries()
    if programs is None or not (programs / "pg_dump").exists():
        pytest.skip("pg_dump is not installed")
    data, backup = tmp_path / "data", tmp_path / "backup"
    backup.mkdir()
    first, second = (postgres.fresh_database(postgres_server, name) for name in ("before_loss", "after_loss"))
    dump = str(backup / "dohyo.dump")
    with running(data, database=SecretStr(first)) as service:
        token, evaluation = fill(service)
        subprocess.run([programs / "pg_dump", "--format=custom", f"--file={dump}", first], check=True)
        copy_files(data, backup)
    shutil.rmtree(data)
    subprocess.run([programs / "pg_restore", "--no-owner", f"--dbname={second}", dump], check=True)
    with running(backup, database=SecretStr(second)) as restored:
        check(restored, token, evaluation)
