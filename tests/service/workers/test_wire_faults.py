"""Workers of every kind on the real wire: good ones, rude ones, slow ones and curious ones."""

from __future__ import annotations

import itertools
import socket
import time

import numpy as np
import pytest

from dohyo.evaluation.agent import make_agent
from dohyo.evaluation.episode.runner import run_episode
from dohyo.evaluation.records.record import AgentInfo
from dohyo.evaluation.records.specifications import Status
from dohyo.service.accounts.model import Role
from dohyo.service.accounts.queries import create_token, revoke_token
from dohyo.service.evaluations.model import EpisodeStatus, EvaluationStatus
from dohyo.service.submissions.model import AgentKind
from dohyo.sumo_networks.scenario import Traffic
from tests.service.served import STEADY, Service, info_of, short, wait_until
from tests.service.workers.wire_worker import JSON, MSGPACK, WireWorker, hire

NUMBERS = itertools.count()


@pytest.fixture(scope="module")
def service(running_service: Service) -> Service:
    return running_service


def steady(**changes: object) -> AgentInfo:
    """A remote agent of a name that no other test uses."""
    return info_of(STEADY).model_copy(update={"name": f"steady-{next(NUMBERS)}", **changes})


@pytest.mark.parametrize("media_type", [MSGPACK, JSON])
def test_local_builtin_and_remote_give_the_same_hash(service: Service, media_type: str) -> None:
    info, benchmark = steady(), short()
    scenario = benchmark.scenarios([0])[0]
    local = run_episode(
        scenario, {"ego": make_agent(STEADY)}, infos={"ego": info}, benchmark=(benchmark.name, benchmark.sha256)
    )
    remote = service.submit(info, benchmark)
    worker = hire(service, info.name, media_type)
    last = worker.drive(worker.acquire())
    assert (last["tick"], last["observations"], last["rewards"]) == (local.ticks, {}, None)
    builtin = service.submit(info, benchmark, kind=AgentKind.BUILTIN)
    assert service.hashes(remote) == service.hashes(builtin) == [local.record_hash]


def test_one_worker_drives_all_egos_of_an_episode(service: Service) -> None:
    info = steady()
    fleet = short(missions=2).model_dump(mode="json")
    fleet["cells"][0]["together"] = True
    benchmark = type(short()).model_validate(fleet)
    scenario = benchmark.scenarios([0])[0]
    names = [mission.name for mission in scenario.missions]
    local = run_episode(
        scenario,
        {name: make_agent(STEADY) for name in names},
        infos=dict.fromkeys(names, info),
        benchmark=(benchmark.name, benchmark.sha256),
    )
    evaluation = service.submit(info, benchmark)
    worker = hire(service, info.name)
    episode = worker.acquire()
    assert list(episode["observations"]) == ["ego-0", "ego-1"], "a name may be that of a public mission"
    assert names == ["drive-0", "drive-1"]
    worker.drive(episode)
    assert service.hashes(evaluation) == [local.record_hash]


def test_nonsense_is_refused_with_what_was_expected_and_hurts_nothing(service: Service) -> None:
    info, benchmark = steady(), short()
    evaluation = service.submit(info, benchmark)
    worker = hire(service, info.name)
    episode = worker.acquire()
    lease = episode["lease"]
    bad: list[tuple[object, str]] = [
        ({"ego": [float("nan"), 0.0]}, "finite"),
        ({"ego": [float("inf"), 0.0]}, "finite"),
        ({"ego": [1.0, 2.0, 3.0]}, "action of 'ego': expected a list of 2 numbers, got a list of 3 numbers"),
        ({"ego": 1.0}, "expected a list of 2 numbers, got a number"),
        ({"ego": "fast"}, "expected numbers of at most 64 bits, got a string"),
        ({"ego": [None, 0.0]}, "got null"),
        ({"ego": [1.0, 0.0], "ghost": [1.0, 0.0]}, "expected actions of ['ego'] only, got ['ghost'] too"),
        ({"ego": {"shape": [9], "dtype": "float32", "data": b"12"}}, "9 values"),
        ({"ego": {"shape": [0, *[10**6] * 7], "dtype": "float32", "data": b""}}, "a possible shape"),
        ({"ego": [[1.0], [2.0, 3.0]]}, "array"),
        ({}, "each of ['ego']"),
        ([1.0, 0.0], "each of ['ego']"),
        ({"somebody": [1.0, 0.0]}, "each of ['ego']"),
    ]
    for actions, says in bad:
        status, problem = worker.step(lease, 0, actions)
        assert (status, says in problem["detail"]) == (422, True), problem
    assert not any(word in worker.sent for word in (b"of dtype", b"inhomogeneous", b"<U", b"ndarray")), "NumPy's words"
    for garbage in (b"", b"\xc1\xff garbage", b"\x93" * 50_000, b"{" * 1000, b"\x81\xa4tick\xa5seven"):
        assert worker.post(f"/v1/leases/{lease}/step", body=garbage)[0] == 422
    for stale in (-1, 5, 2**40):
        status, problem = worker.step(lease, stale, {"ego": [1.0, 0.0]})
        assert (status, problem["expected_tick"]) == (409, 0)
    worker.drive(episode)
    builtin = service.submit(info, benchmark, kind=AgentKind.BUILTIN)
    assert service.hashes(evaluation) == service.hashes(builtin)


@pytest.mark.parametrize("chunked", [False, True])
def test_a_hundred_megabytes_are_not_read(service: Service, chunked: bool) -> None:
    info = steady()
    service.submit(info, short())
    worker = hire(service, info.name)
    episode = worker.acquire()
    with socket.create_connection(("127.0.0.1", service.port), timeout=120) as raw:
        length = "Transfer-Encoding: chunked" if chunked else "Content-Length: 100000000"
        raw.sendall(
            f"POST /v1/leases/{episode['lease']}/step HTTP/1.1\r\nHost: x\r\nContent-Type: {MSGPACK}\r\n"
            f"Authorization: Bearer {worker.token}\r\n{length}\r\n\r\n".encode()
        )
        sent, answer = 0, b""
        raw.settimeout(0.2)
        while sent < 100_000_000 and not answer:
            piece = b"x" * 65536
            try:
                raw.sendall(b"10000\r\n" + piece + b"\r\n" if chunked else piece)
                sent += len(piece)
                raw.setblocking(False)
                answer = raw.recv(65536)
            except BlockingIOError:
                pass
            except OSError:
                break
            finally:
                raw.settimeout(0.2)
        assert answer.startswith(b"HTTP/1.1 413") or sent < 20_000_000
        assert sent < 20_000_000
    worker.drive(episode)


def test_an_answer_that_comes_twice_or_late_changes_nothing(service: Service) -> None:
    info, benchmark = steady(), short()
    evaluation = service.submit(info, benchmark)
    worker = hire(service, info.name)
    episode = worker.acquire()
    reply = {"tick": 0, "done": False}
    while not reply["done"]:
        tick = reply["tick"]
        status, reply = worker.step(episode["lease"], tick, {"ego": [6.0, 0.0]})
        assert status == 200
        assert worker.step(episode["lease"], tick, {"ego": [0.0, 1.0]}) == (200, reply)
        if tick:
            assert worker.step(episode["lease"], tick - 1, {"ego": [0.0, 1.0]})[0] in (409, 410)
    assert service.hashes(evaluation) == service.hashes(service.submit(info, benchmark, kind=AgentKind.BUILTIN))


def test_a_worker_that_answers_too_late_has_a_slow_agent(service: Service) -> None:
    info, benchmark = steady(), short()
    evaluation = service.submit(info, benchmark, act_deadline_s=5.0)
    worker = hire(service, info.name)
    episode = worker.acquire()
    reply = worker.drive(episode, steps=5)
    path = f"/v1/leases/{episode['lease']}/heartbeat"  # no sleep: while the service stands still, no time passes
    wait_until(lambda: worker.post(path)[0] == 410, "no decision is ever too late")
    status, problem = worker.step(episode["lease"], reply["tick"], {"ego": [6.0, 0.0]})
    assert (status, "took longer than 5 s" in problem["detail"]) == (410, True)
    (ego,) = service.record(evaluation).egos
    assert (ego.status, ego.failure) == (Status.AGENT_DEADLINE, f"agent '{info.name}' took longer than 5 s")
    assert service.episodes(evaluation)[0].attempts == 1


def test_a_worker_tells_that_its_agent_failed(service: Service) -> None:
    info = steady()
    evaluation = service.submit(info, short())
    worker = hire(service, info.name)
    episode = worker.acquire()
    worker.drive(episode, steps=3)
    assert worker.post(f"/v1/leases/{episode['lease']}/release", {"error": "ValueError: no"})[0] == 204
    assert worker.post(f"/v1/leases/{episode['lease']}/heartbeat")[0] == 410
    (ego,) = service.record(evaluation).egos
    assert (ego.status, ego.failure) == (Status.AGENT_RAISED, "ValueError: no")


def test_realtime_goes_on_without_the_worker_and_says_so(service: Service) -> None:
    info = steady()
    evaluation = service.submit(info, short(), slow_policy="realtime")
    worker = hire(service, info.name)
    episode = worker.acquire()
    assert episode["slow_policy"] == "realtime"
    reply = worker.drive(episode, steps=3)
    missed, tick = reply["missed"], reply["tick"]  # none on a fast machine
    while reply["missed"] < missed + 5:  # once on a fast machine
        assert not reply["done"], "the drive waited for its worker"
        time.sleep(1.0)
        status, reply = worker.step(episode["lease"], reply["tick"], {"ego": [6.0, 0.0]})
        assert status == 200
    assert reply["tick"] >= tick + 5
    last = worker.drive(episode | reply)
    timing = service.record(evaluation).timing
    assert timing is not None
    assert timing.realtime
    assert timing.missed == last["missed"] >= reply["missed"]


def test_another_owners_agent_lease_and_worker_are_out_of_reach(service: Service) -> None:
    info = steady()
    service.submit(info, short())
    status, _ = hire(service, info.name).post("/v1/workers", {"agent": info.name}, service.other_token)
    assert status == 404
    mine, theirs = hire(service, info.name), hire(service, info.name)
    episode = mine.acquire()
    for path in ("step", "heartbeat", "release"):
        document = {"tick": 0, "actions": {"ego": [6.0, 0.0]}} if path == "step" else {}
        assert theirs.post(f"/v1/leases/{episode['lease']}/{path}", document)[0] == 410
    assert theirs.post(f"/v1/workers/{mine.worker}/acquire?wait=0")[0] == 404
    for token in ("wrong", service.token, ""):
        assert mine.post(f"/v1/leases/{episode['lease']}/heartbeat", token=token or "-")[0] == 401
    mine.drive(episode)


def test_a_worker_for_a_version_that_does_not_exist_is_refused(service: Service) -> None:
    """It would wait for ever."""
    info = steady()
    evaluation = service.submit(info, short())
    worker = hire(service, info.name)
    status, problem = worker.post("/v1/workers", {"agent": info.name, "version": 7}, service.token)
    assert (status, problem["detail"]) == (404, f"agent '{info.name}' has no version 7")
    assert worker.post("/v1/workers", {"agent": info.name, "version": 1}, service.token)[0] == 201
    worker.drive(worker.acquire())
    assert service.wait(evaluation).status is EvaluationStatus.DONE


def test_a_worker_is_sent_nothing_but_its_tracks_sensors(service: Service) -> None:
    info = steady(track="sensors", sensors=("speedometer", "navigation"))
    crowd = short(name="secret-benchmark").model_dump(mode="json")
    crowd["cells"][0] |= {"traffic": Traffic(vehicles=15, pedestrians=10, warm_up_s=5.0).model_dump(), "name": "hidden"}
    benchmark = type(short()).model_validate(crowd)
    evaluation = service.submit(info, benchmark)
    worker = hire(service, info.name, JSON)
    episode = worker.acquire()
    assert set(episode["observations"]["ego"]) == {"speedometer", "navigation"}
    worker.drive(episode)
    record = service.record(evaluation)
    text = worker.sent.decode().replace("clipped", "")
    (scenario,) = benchmark.scenarios([0])
    # Actors, lights and lanes by name; the scenario, its traffic and its limits; how well the drive goes.
    trajectory_names = {infraction.actor for ego in record.egos for infraction in ego.infractions if infraction.actor}
    hidden = {"secret-benchmark", "hidden", scenario.name, "vehicles", "pedestrians", "traffic", "clear", "time_limit"}
    hidden |= {"infraction", "collision", "status", "objects", "conflicts", "junctions_ahead", "veh", "ped", "bike"}
    for word in hidden | trajectory_names:
        assert word not in text, word
    allowed = {
        "lease",
        "attempt",
        "dt_s",
        "deadline_ms",
        "first_deadline_ms",
        "slow_policy",
        "spec",
        "tick",
        "missions",
    }
    assert set(episode) == allowed | {"seed", "observations"}
    assert episode["missions"] == [{"name": "ego"}]


def test_sensors_above_the_track_end_the_evaluation_with_the_reason(service: Service) -> None:
    info = steady(track="sensors", sensors=("objects",))
    evaluation = service.submit(info, short())
    worker = hire(service, info.name)
    worker.post(f"/v1/workers/{worker.worker}/acquire?wait=1")
    ended = service.wait(evaluation)
    assert ended.status is EvaluationStatus.FAILED
    assert "sensor 'objects' needs track 'privileged'" in (ended.failure or "")
    assert {one.status for one in service.episodes(evaluation)} == {EpisodeStatus.CANCELLED}


def test_actions_out_of_range_are_clipped_and_counted(service: Service) -> None:
    info = steady()
    service.submit(info, short())
    worker = hire(service, info.name)
    episode = worker.acquire()
    reply, counts = episode, []
    for action in ([6.0, 0.0], [6.0, 2.0], [-1.0, -7.0], [6.0, 0.0]):
        _, reply = worker.step(episode["lease"], reply["tick"], {"ego": action})
        counts.append(reply["clipped"])
    assert counts == [0, 1, 2, 2]
    worker.drive(episode | reply)


def test_integers_of_more_than_64_bits_end_the_evaluation_and_break_no_acquire(service: Service) -> None:
    info = steady()
    poisoned = info.model_copy(update={"settings": {"large": 2**70}})
    evaluation = service.submit(poisoned, short())
    worker = hire(service, info.name)
    assert worker.post(f"/v1/workers/{worker.worker}/acquire?wait=2")[0] == 204
    assert "integers of at most 64 bits" in (service.wait(evaluation).failure or "")
    good = service.submit(info, short())
    worker.drive(worker.acquire())
    assert service.hashes(good)


def test_a_revoked_token_stops_its_worker(service: Service) -> None:
    """Review: the worker of a revoked token drove on until its episode's end."""
    info = steady()
    evaluation = service.submit(info, short())
    with service.database.session() as session:
        token, secret = create_token(session, "owner", Role.WORKER)
    stopped = WireWorker(service.port, secret, info.name)
    episode = stopped.acquire()
    tick = stopped.drive(episode, steps=2)["tick"]
    with service.database.session() as session:
        revoke_token(session, token.id)
    path = f"/v1/leases/{episode['lease']}/heartbeat"
    wait_until(lambda: stopped.post(path)[0] == 401, "the worker of a revoked token is still heard")
    assert stopped.step(episode["lease"], tick, {"ego": [6.0, 0.0]})[0] == 401
    other = hire(service, info.name)
    other.drive(other.acquire())
    assert service.hashes(evaluation)


def test_an_image_as_json_comes_whole(service: Service) -> None:
    info = steady(track="sensors", sensors=("camera_semantic",))
    service.submit(info, short())
    worker = hire(service, info.name, JSON)
    episode = worker.acquire()
    first = np.array(episode["observations"]["ego"]["camera_semantic"])
    _, reply = worker.step(episode["lease"], 0, {"ego": [6.0, 0.0]})
    second = np.array(reply["observations"]["ego"]["camera_semantic"])
    assert first.shape == second.shape
    assert first.size > 10_000
    worker.post(f"/v1/leases/{episode['lease']}/release", {"error": "enough"})
