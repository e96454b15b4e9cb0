"""`dohyo serve` from outside: its first token, its signals, its databases, and what it refuses."""

from __future__ import annotations

import json
import re
import signal
import sqlite3
import threading
from pathlib import Path

import httpx
import pytest
from pydantic import ValidationError
from sqlalchemy import select
from sqlalchemy.exc import OperationalError

from dohyo.service.database.engine import Database
from dohyo.service.evaluations.model import EpisodeStatus, Evaluation
from dohyo.service.evaluations.queries import list_episodes
from dohyo.service.server import check_exposure
from dohyo.service.settings import Settings, unknown_variables
from dohyo.sumo_networks.errors import InvalidInputError
from tests.service.served import wait_until
from tests.service.serving import command, serving


@pytest.mark.slow
def test_the_first_token_is_printed_once_and_logs_hold_no_secret(tmp_path: Path) -> None:
    data = tmp_path / "data"
    with serving(data) as served:
        token = served.token
        assert served.url.startswith("http://127.0.0.1:")
        assert served.ask("GET", "/v1/me")["role"] == "admin"
        assert served.end() == 0
        lines = [line for line in served.log if line["message"] == "request"]
        assert {line["path"] for line in lines} >= {"/v1/me", "/health/ready"}
        assert token not in json.dumps(served.log)
    assert oct(data.stat().st_mode)[-3:] == "700"
    with serving(data) as again:
        assert len(again.printed) == 1
        assert (
            httpx.get(f"{again.url}/v1/me", headers={"authorization": f"Bearer {token}"}, timeout=120).status_code
            == 200
        )
        assert again.end(signal.SIGINT) == 0


@pytest.mark.slow
def test_tokens_from_the_command_line_work_at_once_and_the_folder_is_taken(tmp_path: Path) -> None:
    data = str(tmp_path / "data")
    with serving(tmp_path / "data") as served:
        made = json.loads(
            command("tokens", "create", "--owner", "team", "--role", "worker", "--data", data, "--json").stdout
        )
        headers = {"authorization": f"Bearer {made['token']}"}
        assert httpx.get(f"{served.url}/v1/me", headers=headers, timeout=120).json()["owner"] == "team"
        listed = command("tokens", "list", "--data", data, "--json").stdout
        assert made["id"] in listed
        assert made["token"] not in listed
        assert command("tokens", "revoke", made["id"], "--data", data).exit_code == 0
        assert httpx.get(f"{served.url}/v1/me", headers=headers, timeout=120).status_code == 401
        missing = command("tokens", "revoke", "tok-none", "--data", data)
        assert isinstance(missing.exception, InvalidInputError)
        second = command("serve", "--port", "0", "--data", data)
        assert isinstance(second.exception, InvalidInputError)
        assert re.fullmatch(r"data folder '.*' is in use by another process: wait .*", str(second.exception))


@pytest.mark.slow
def test_sigterm_under_load_ends_streams_and_queues_again_what_was_unfinished(tmp_path: Path) -> None:
    with serving(tmp_path / "data") as served:
        served.ask("POST", "/v1/agents", {"name": "a"})
        served.ask("POST", "/v1/agents/a/submissions", {"kind": "builtin", "entry": "idm"})
        order = {"agent": "a", "benchmark": "quickstart", "seeds": [0, 1, 2]}
        evaluation = served.ask("POST", "/v1/evaluations", order)["id"]
        with httpx.stream("GET", f"{served.url}/v1/evaluations/{evaluation}/progress", timeout=120) as stream:
            events = stream.iter_lines()
            while "running" not in next(events):
                pass
            assert served.end() == 0
        assert not [line for line in served.log if line["level"] == "error"]
    database = Database(Settings(data=tmp_path / "data").database_url)
    with database.reading() as session:
        episodes = list_episodes(session, evaluation)
        assert not session.get_one(Evaluation, evaluation).status.finished
    database.close()
    assert len(episodes) == 18
    assert {one.status for one in episodes} <= {EpisodeStatus.DONE, EpisodeStatus.QUEUED}
    assert all(one.attempts == (1 if one.status is EpisodeStatus.DONE else 0) for one in episodes)


# An order lasts until a test makes the file.
SLOW_TO_QUEUE = """
import dohyo.service.server, pathlib, time
from dohyo.service.evaluations import routes as evaluations
dohyo.service.server.CLOSE_S = 0.5
find = evaluations.find_benchmark

def find_late(name):
    print("ordering", flush=True)
    while not pathlib.Path({end!r}).exists():
        time.sleep(0.01)
    return find(name)

evaluations.find_benchmark = find_late
"""


@pytest.mark.slow
def test_a_request_that_outlasts_the_shutdown_is_told_so_and_leaves_nothing(tmp_path: Path) -> None:
    answers: list[httpx.Response] = []
    end = tmp_path / "end"
    with serving(tmp_path / "data", before=SLOW_TO_QUEUE.format(end=str(end))) as served:
        served.ask("POST", "/v1/agents", {"name": "a"})
        served.ask("POST", "/v1/agents/a/submissions", {"kind": "remote"})
        headers = {"authorization": f"Bearer {served.token}"}
        order = {"agent": "a", "benchmark": "quickstart"}

        def ask() -> None:
            answers.append(httpx.post(f"{served.url}/v1/evaluations", json=order, headers=headers, timeout=120))

        asking = threading.Thread(target=ask)
        asking.start()
        wait_until(lambda: "ordering" in served.printed, "the order does not come")
        served.process.send_signal(signal.SIGTERM)
        asking.join(120)
        end.touch()
        assert served.ended() == 0
        assert not [line for line in served.log if "Traceback" in line.get("exception", "")]
    (answer,) = answers
    assert (answer.status_code, answer.json()["status"]) == (503, 503)
    assert int(answer.headers["retry-after"]) > 0
    database = Database(Settings(data=tmp_path / "data").database_url)
    with database.reading() as session:
        assert session.scalars(select(Evaluation)).all() == []
    database.close()


def test_beyond_this_machine_only_with_tls_or_on_purpose(tmp_path: Path, certified: tuple[Path, Path]) -> None:
    pem, key = certified
    for host in ("127.0.0.1", "::1", "localhost", "127.9.9.9"):
        check_exposure(Settings(host=host))
    for host in ("0.0.0.0", "::", "192.168.0.7", "example.org"):
        with pytest.raises(InvalidInputError, match="unencrypted"):
            check_exposure(Settings(host=host))
        check_exposure(Settings(host=host, insecure=True))
        check_exposure(Settings(host=host, tls_certificate=pem, tls_key=key))
    with pytest.raises(InvalidInputError, match="both"):
        check_exposure(Settings(tls_certificate=pem))
    with pytest.raises(InvalidInputError, match="no file"):
        check_exposure(Settings(tls_certificate=pem, tls_key=tmp_path / "none.pem"))


def test_a_decision_may_take_a_tenth_of_a_second_at_least() -> None:
    assert Settings(act_deadline_s=0.1).act_deadline_s == 0.1
    with pytest.raises(ValidationError):
        Settings(act_deadline_s=0.09)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--host", "0.0.0.0"), "unencrypted"),
        (("--executor", "magic"), "executor"),
        (("--database", "mysql://user:hunter2@host/x"), "expected sqlite or postgresql"),
        (("--database", "postgresql://user:hunter2@host:abc/x"), "expected a URL such as"),
        (("--database", "postgresql://user:hunter2@[::1/x"), "expected a URL such as"),
        (("--database", "sqlite+aiosqlite:///x.db"), "expected sqlite or postgresql"),
        (("--database", "sqlite://hunter2/x.db"), "expected a URL such as"),
        (("--data", "/proc/nowhere"), "cannot be used"),
        (("--host", "192.0.2.1", "--insecure"), "cannot listen"),
    ],
)
def test_what_cannot_be_served_is_refused(tmp_path: Path, options: tuple[str, ...], says: str) -> None:
    data = () if "--data" in options else ("--data", str(tmp_path / "data"))
    done = command("serve", "--port", "0", *data, *options)
    assert isinstance(done.exception, InvalidInputError)
    assert says in str(done.exception)
    assert "hunter2" not in str(done.exception) + done.output


def test_a_file_that_is_no_database_is_one_line(tmp_path: Path) -> None:
    file = tmp_path / "x.db"
    file.write_text("no database " * 100)
    done = command("serve", "--port", "0", "--data", str(tmp_path / "data"), "--database", f"sqlite:///{file}")
    assert isinstance(done.exception, InvalidInputError)
    assert str(done.exception) == "database: it cannot be used: file is not a database"


def test_a_start_without_room_is_one_line_and_shows_no_token(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_: Database) -> None:
        raise OperationalError("CREATE TABLE", {}, sqlite3.OperationalError("database or disk is full"))

    monkeypatch.setattr(Database, "migrate", full)
    done = command("serve", "--port", "0", "--data", str(tmp_path / "data"))
    assert isinstance(done.exception, InvalidInputError)
    assert str(done.exception) == "database: it cannot be used: database or disk is full"
    assert done.output == ""


@pytest.mark.parametrize("days", ["1e7", "inf", "nan", "0"])
@pytest.mark.parametrize("setting", ["jobs_kept_days", "records_kept_days"])
def test_days_have_an_upper_bound(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, setting: str, days: str) -> None:
    """Before, the service started, and each removal failed since there is no such day."""
    monkeypatch.setenv(f"DOHYO_{setting.upper()}", days)
    done = command("serve", "--port", "0", "--data", str(tmp_path / "data"))
    assert isinstance(done.exception, InvalidInputError)
    assert setting in str(done.exception)


def test_variables_that_do_nothing_are_told_with_the_nearest_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before, the service started without a word, and with the default."""
    monkeypatch.chdir(tmp_path)
    Path(".env").write_text("DOHYO_RUNS_PER_DAYS=3\nOTHER=1\nDOHYO_PORT=0\n")
    for name in ("DOHYO_PROCESES", "DOHYO_XYLOPHONE", "DOHYO_HOME", "DOHYO_TOKEN", "DOHYO_JOBS", "DOHYOS"):
        monkeypatch.setenv(name, "3")
    sentences = [
        "DOHYO_PROCESES is no setting and does nothing; did you mean DOHYO_PROCESSES?",
        "DOHYO_RUNS_PER_DAYS is no setting and does nothing; did you mean DOHYO_RUNS_PER_DAY?",
        "DOHYO_XYLOPHONE is no setting and does nothing",
    ]
    assert unknown_variables() == sentences
    (tmp_path / "x.db").write_text("no database " * 100)
    done = command("serve", "--data", str(tmp_path / "data"), "--database", f"sqlite:///{tmp_path / 'x.db'}")
    assert [json.loads(line)["message"] for line in done.stderr.splitlines()] == sentences


def test_tokens_need_a_service(tmp_path: Path) -> None:
    done = command("tokens", "list", "--data", str(tmp_path / "none"))
    assert isinstance(done.exception, InvalidInputError)
    assert not (tmp_path / "none").exists()
