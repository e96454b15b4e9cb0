"""Jobs: ordered, run a few at once in fair turns, followed, cancelled, repeated after the death of the service."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from pydantic import SecretStr
from sqlalchemy.orm import Session

from dohyo.service.accounts.model import Role
from dohyo.service.database.engine import Database
from dohyo.service.errors import StorageFullError
from dohyo.service.jobs import queries, runner
from dohyo.service.jobs.kind import Kind, Made, Task
from dohyo.service.jobs.kinds import KINDS
from dohyo.service.jobs.model import JobStatus
from dohyo.service.jobs.orders import answer_job, order_job
from dohyo.service.settings import Settings
from dohyo.sumo_networks.errors import InvalidInputError
from tests.service.harness import Harness, assert_problem, running
from tests.service.served import wait_until


class Desk:
    """Kinds of jobs that a test holds and lets go.

    Attributes:
        began: Owners of the jobs that began, in this order.
        free: What all jobs of kind "held" wait for.
    """

    def __init__(self) -> None:
        self.began: list[str] = []
        self.free = threading.Event()

    def held(self, task: Task) -> Made:
        self.began.append(task.owner)
        while not self.free.wait(0.01):
            if task.stop.is_set():
                raise InvalidInputError("stopped")
        return Made({"sum": sum(task.arguments.get("terms", []))}, "/v1/sums/1")

    def upload(self, task: Task) -> Made:
        return Made({"bytes": len(task.file.read_bytes())})

    @property
    def kinds(self) -> dict[str, Kind]:
        def refuses(task: Task) -> Made:
            raise InvalidInputError("expected better terms")

        def breaks(task: Task) -> Made:
            raise RuntimeError("a secret of the program")

        def full(task: Task) -> Made:
            raise StorageFullError

        named = {"held": self.held, "upload": self.upload, "refuses": refuses, "breaks": breaks, "full": full}
        kinds = {name: Kind(name, run, limit_s=60.0) for name, run in named.items()}
        kinds["brief"] = Kind("brief", self.held, limit_s=0.05)
        kinds["once"] = Kind("once", self.held, limit_s=60.0, repeatable=False)
        return kinds


@pytest.fixture
def desk(monkeypatch: pytest.MonkeyPatch) -> Iterator[Desk]:
    desk = Desk()
    for name, kind in desk.kinds.items():
        monkeypatch.setitem(KINDS, name, kind)  # type: ignore[arg-type]
    yield desk
    desk.free.set()


@pytest.fixture
def service(tmp_path: Path, database_url: str, desk: Desk) -> Iterator[Harness]:
    """A service on each database with the kinds of the desk, two jobs at once."""
    with running(tmp_path / "data", database=SecretStr(database_url), jobs=2, jobs_per_owner=4, jobs_limit=6) as made:
        yield made
        desk.free.set()


def order(service: Harness, owner: str, kind: str = "held", terms: tuple[int, ...] = (), **options: Any) -> str:
    assert service.client.portal is not None

    async def call() -> str:
        return await order_job(service.services, owner, kind, {"terms": list(terms)}, **options)

    return service.client.portal.call(call)


def ended(service: Harness, job: str, wait_s: float = 30.0) -> Any:
    assert service.client.portal is not None
    return service.client.portal.call(answer_job, service.services, job, wait_s)


def status(service: Harness, job: str) -> str:
    with service.services.database.reading() as session:
        found = queries.find_job(session, job)
        assert found is not None
        return found.status.value


def test_an_order_is_answered_at_once_or_when_it_is_done(service: Harness, desk: Desk) -> None:
    job = order(service, "team", terms=(1, 2))
    answer = ended(service, job, 0.0)
    assert (answer.status_code, answer.headers["location"]) == (202, f"/v1/jobs/{job}")
    desk.free.set()
    answer = ended(service, job)
    assert (answer.status_code, answer.headers["location"], answer.body) == (201, "/v1/sums/1", b'{"sum":3}')
    view = service.caller("team").get(f"/v1/jobs/{job}").json()
    assert (view["status"], view["result"], view["answer"]) == ("done", "/v1/sums/1", {"sum": 3})
    assert view["position"] is None


@pytest.mark.parametrize(
    ("kind", "code", "says"),
    [
        ("refuses", 422, "expected better terms"),
        ("breaks", 500, "its log tells more under job-"),
        ("full", 507, "no space"),
        ("brief", 422, "longer than 0.05 s"),
        ("unheard-of", 422, "unheard-of"),
    ],
)
def test_the_failure_of_a_job_is_the_answer_of_its_order(service: Harness, kind: str, code: int, says: str) -> None:
    job = order(service, "team", kind)
    answer = ended(service, job)
    assert answer.status_code == code
    assert says in answer.body.decode()
    assert "secret" not in answer.body.decode()
    failure = service.caller("team").get(f"/v1/jobs/{job}").json()["failure"]
    assert (failure["status"], says in failure["detail"]) == (code, True)


def test_one_owner_never_has_all_places_and_a_newcomer_begins_at_once(service: Harness, desk: Desk) -> None:
    hog = [order(service, "hog") for _ in range(3)]
    wait_until(lambda: desk.began == ["hog"], "the first job does not begin")
    assert order(service, "newcomer")
    wait_until(lambda: desk.began == ["hog", "newcomer"], "the newcomer waits behind the hog")
    assert [status(service, job) for job in hog] == ["running", "queued", "queued"]
    view = service.caller("hog").get(f"/v1/jobs/{hog[2]}").json()
    assert view["position"] == 1


def test_the_queue_has_a_limit_for_each_owner_and_for_all(service: Harness) -> None:
    for _ in range(4):
        order(service, "hog")
    with pytest.raises(Exception, match="4 unfinished jobs"):
        order(service, "hog")
    for owner in ("a", "b"):
        order(service, owner)
    with pytest.raises(Exception, match="at most 6 jobs"):
        order(service, "c")


def test_jobs_are_their_owners_and_administrators_only(service: Harness, desk: Desk) -> None:
    job = order(service, "team")
    other, admin = service.caller("other"), service.caller("root", Role.ADMIN)
    for call in (other.get, other.delete):
        assert_problem(call(f"/v1/jobs/{job}"), 404, job)
    assert_problem(other.get(f"/v1/jobs/{job}/events"), 404, job)
    assert_problem(service.client.get(f"/v1/jobs/{job}"), 401)
    assert other.get("/v1/jobs").json()["items"] == []
    assert [one["id"] for one in admin.get("/v1/jobs").json()["items"]] == [job]
    reader = service.caller("team", Role.READER)
    assert reader.get(f"/v1/jobs/{job}").status_code == 200
    assert_problem(reader.delete(f"/v1/jobs/{job}"), 403)
    assert status(service, job) in ("queued", "running")


def test_a_cancelled_job_ends_whether_it_runs_or_waits(service: Harness, desk: Desk) -> None:
    runs, waits = order(service, "team"), order(service, "team")
    wait_until(lambda: status(service, runs) == "running", "it does not begin")
    team = service.caller("team")
    for job in (waits, runs):
        assert team.delete(f"/v1/jobs/{job}").status_code == 204
        assert team.get(f"/v1/jobs/{job}").json()["status"] == "cancelled"
    wait_until(lambda: not service.services.jobs._live, "the work goes on")
    assert team.delete(f"/v1/jobs/{runs}").status_code == 204
    assert_problem(team.get(f"/v1/jobs/{runs}"), 404)


def test_a_job_that_is_cancelled_just_after_its_start_was_stored_does_no_work(
    service: Harness, desk: Desk, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The runner learns of the commit later than the request that cancels the job."""
    stored, cancelled, start, session_of = threading.Event(), threading.Event(), queries.start, Database.session

    def start_marked(session: Session, job_id: str) -> bool:
        session.info["starts"] = True
        return start(session, job_id)

    @contextmanager
    def slow_to_return(database: Database) -> Iterator[Session]:
        with session_of(database) as session:
            yield session
        if session.info.get("starts"):
            stored.set()
            assert cancelled.wait(120.0)

    monkeypatch.setattr(queries, "start", start_marked)
    monkeypatch.setattr(Database, "session", slow_to_return)
    desk.free.set()
    given = tmp_path / "given"
    given.write_bytes(b"12345")
    job = order(service, "team", file=given)
    assert stored.wait(120.0)
    assert service.caller("team").delete(f"/v1/jobs/{job}").status_code == 204
    cancelled.set()
    assert ended(service, order(service, "other")).status_code == 201
    wait_until(lambda: not service.services.jobs._live, "a place is held")
    assert desk.began == ["other"]
    assert status(service, job) == "cancelled"
    assert list(service.services.settings.uploads.iterdir()) == []


def test_its_events_end_with_it(service: Harness, desk: Desk) -> None:
    job = order(service, "team")
    threading.Timer(0.1, desk.free.set).start()
    text = service.caller("team").get(f"/v1/jobs/{job}/events").text
    names = [line.removeprefix("event: ") for line in text.splitlines() if line.startswith("event: ")]
    assert names[0] == "state"
    assert names[-1] == "end"
    assert service.caller("team").get(f"/v1/jobs/{job}/events", headers={"last-event-id": "end"}).status_code == 204


def test_the_same_key_orders_one_job(service: Harness, tmp_path: Path) -> None:
    first, again = (order(service, "team", terms=(1,), key="k") for _ in range(2))
    assert first == again
    with pytest.raises(InvalidInputError, match="another request"):
        order(service, "team", terms=(2,), key="k")
    assert order(service, "other", terms=(2,), key="k") != first


def test_an_uploaded_file_is_the_jobs_until_its_end(service: Harness, tmp_path: Path) -> None:
    given = tmp_path / "given"
    given.write_bytes(b"12345")
    job = order(service, "team", "upload", file=given)
    assert ended(service, job).body == b'{"bytes":5}'
    wait_until(lambda: list(service.services.settings.uploads.iterdir()) == [], "the file stays")


def test_jobs_that_ran_when_the_service_died_are_repeated_or_failed(
    tmp_path: Path, database_url: str, desk: Desk
) -> None:
    settings: dict[str, Any] = {"database": SecretStr(database_url), "jobs": 4}
    with running(tmp_path / "data", **settings) as service:
        again, once, fatal = order(service, "a"), order(service, "b", "once"), order(service, "c")
        wait_until(lambda: len(desk.began) == 3, "they do not begin")
    database = Database(database_url)
    with database.session() as session:  # as a service that was killed leaves them
        for job, starts in ((again, 1), (once, 1), (fatal, runner.MOST_STARTS)):
            queries.find_job(session, job).status = JobStatus.RUNNING  # type: ignore[union-attr]
            queries.find_job(session, job).starts = starts  # type: ignore[union-attr]
    database.close()
    desk.free.set()
    with running(tmp_path / "data", **settings) as service:
        assert ended(service, again).status_code == 201
        for job in (once, fatal):
            answer = ended(service, job)
            assert answer.status_code == 503
            assert "order it again" in answer.body.decode()


def test_a_stopped_service_leaves_its_jobs_to_the_next(tmp_path: Path, database_url: str, desk: Desk) -> None:
    settings: dict[str, Any] = {"database": SecretStr(database_url)}
    with running(tmp_path / "data", **settings) as service:
        job = order(service, "team")
        wait_until(lambda: desk.began == ["team"], "it does not begin")
    desk.free.set()
    with running(tmp_path / "data", **settings) as service:
        assert ended(service, job).status_code == 201


def test_a_job_that_is_taken_as_the_service_stops_is_left_to_the_next(
    tmp_path: Path, database_url: str, desk: Desk, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The stop comes before the commit of the take, in a thread that nobody can stop."""
    taking, start = threading.Event(), queries.start

    def start_late(session: Session, job_id: str) -> bool:
        taking.set()
        time.sleep(0.5)  # meanwhile the stop goes as far as it can
        return start(session, job_id)

    monkeypatch.setattr(queries, "start", start_late)
    with running(tmp_path / "data", database=SecretStr(database_url)) as service:
        job = order(service, "team")
        assert taking.wait(120.0)
    database = Database(database_url)
    with database.reading() as session:
        left = queries.find_job(session, job)
        assert left is not None
        assert (left.status, left.starts) == (JobStatus.QUEUED, 0)
    database.close()


def test_old_jobs_are_deleted_and_new_ones_kept(tmp_path: Path, desk: Desk) -> None:
    desk.free.set()
    with running(tmp_path / "data") as service:
        job = order(service, "team")
        ended(service, job)
    with running(tmp_path / "data") as service:  # which sweeps when it starts
        assert status(service, job) == "done"
    with running(tmp_path / "data", jobs_kept_days=1e-9) as service:
        assert_problem(service.caller("team").get(f"/v1/jobs/{job}"), 404)


def test_settings_without_places_are_refused() -> None:
    with pytest.raises(ValueError, match="greater than or equal to 1"):
        Settings(jobs=0)


def test_a_digit_that_is_no_decimal_is_an_ignored_preference(service: Harness) -> None:
    authorization = service.caller("team").headers["authorization"].encode()
    headers = [(b"authorization", authorization), (b"prefer", b"wait=\xb2")]
    answer = service.client.post("/v1/episodes/ep-none/verify", headers=headers)
    assert_problem(answer, 404, "ep-none")
