"""Backup and restore as docs/organisers/hosting.md says, of a service that runs, on both databases."""

from __future__ import annotations

import re
import shutil
import sqlite3
import subprocess
from pathlib import Path

import pytest
from pydantic import SecretStr

from dohyo.evaluation.records.store import seal, write_record
from dohyo.service.database.base import now
from dohyo.service.database.identity import check_folder, claim
from dohyo.service.signing.keys import SigningKeys
from dohyo.service.worlds.model import World, WorldStatus
from dohyo.service.worlds.records import record_path
from tests.evaluation.builders import drive, ego, episode
from tests.service import postgres
from tests.service.harness import Caller, Harness, running

HOSTING = Path(__file__).parents[2] / "docs/organisers/hosting.md"
DATABASE = {"dohyo.db", "dohyo.db-wal", "dohyo.db-shm", "dohyo.db.lock"}
WITHOUT_COPY = {".lock", "staging", "uploads"}


def named_files() -> list[str]:
    """Names in the data folder that the guide copies."""
    (command,) = re.findall(r"^cp -a (.*) BACKUP/$", HOSTING.read_text(), re.MULTILINE)
    return [one.removeprefix("DIR/") for one in command.split()]


def retire_key(data: Path) -> str:
    """Makes a key that signed before; its public part."""
    keys = SigningKeys(data / "retired-signing-keys" / "2026-11.pem", data)
    (data / "retired-signing-keys").mkdir(parents=True)
    keys.prepare()
    return keys.public


def fill(service: Harness) -> tuple[str, str]:
    """An agent, an evaluation, and a world with a record; returns a token and the evaluation."""
    team, settings = service.caller("team"), service.services.settings
    team.agent("kept")
    (settings.records / "ab").mkdir()
    (settings.records / "ab" / "record.json").write_text("{}")
    claim(settings.data, service.services.database)
    record = seal(episode(ego(progress_m=100.0)))
    with service.services.database.session() as session:
        ended = {"status": WorldStatus.DONE, "finished": now(), "record_hash": record.record_hash, "kept_bytes": 2}
        session.add(World(id="wo-kept", owner="team", order={"network": "ingolstadt"}, **ended))
    path = record_path(settings, "wo-kept")
    write_record(path.parent, path.stem, record, drive())
    for folder in ("networks", "benchmarks", "logs"):  # made by imports, an organiser, and `dohyo prepare`
        (settings.data / folder).mkdir()
    return team.headers["authorization"].removeprefix("Bearer "), team.evaluation("kept")


def copy_files(data: Path, backup: Path) -> None:
    assert {one.name for one in data.iterdir()} - DATABASE - WITHOUT_COPY == set(named_files())
    for name in named_files():
        if (data / name).is_dir():
            shutil.copytree(data / name, backup / name)
        elif (data / name).exists():
            shutil.copy2(data / name, backup / name)


def check(service: Harness, token: str, evaluation: str, retired_key: str) -> None:
    team, settings = Caller(service.client, token), service.services.settings
    check_folder(settings.data, settings.records, service.services.database)
    assert team.get(f"/v1/evaluations/{evaluation}").json()["agent"] == "kept"
    assert (settings.records / "ab" / "record.json").is_file()
    assert team.get("/v1/worlds/wo-kept/record").json()["egos"][0]["progress_m"] == 100.0
    assert team.get("/v1/worlds/wo-kept/trajectory").content[:4] == b"PAR1"
    assert team.get("/v1/signing-key").json()["retired"] == [retired_key]
    assert team.get("/health/ready").status_code == 200


def test_sqlite(tmp_path: Path) -> None:
    data, backup = tmp_path / "data", tmp_path / "backup"
    backup.mkdir()
    retired = retire_key(data)
    with running(data) as service:
        token, evaluation = fill(service)
        with sqlite3.connect(data / "dohyo.db") as connection:
            connection.execute(f"VACUUM INTO '{backup / 'dohyo.db'}'")
        copy_files(data, backup)
    shutil.rmtree(data)
    with running(backup) as restored:
        check(restored, token, evaluation, retired)


def test_postgresql(tmp_path: Path, postgres_server: str) -> None:
    programs = postgres.binaries()
    if programs is None or not (programs / "pg_dump").exists():
        pytest.skip("pg_dump is not installed")
    data, backup = tmp_path / "data", tmp_path / "backup"
    backup.mkdir()
    first, second = (postgres.fresh_database(postgres_server, name) for name in ("before_loss", "after_loss"))
    dump, retired = str(backup / "dohyo.dump"), retire_key(data)
    with running(data, database=SecretStr(first)) as service:
        token, evaluation = fill(service)
        subprocess.run([programs / "pg_dump", "--format=custom", f"--file={dump}", first], check=True)
        copy_files(data, backup)
    shutil.rmtree(data)
    subprocess.run([programs / "pg_restore", "--no-owner", f"--dbname={second}", dump], check=True)
    with running(backup, database=SecretStr(second)) as restored:
        check(restored, token, evaluation, retired)
