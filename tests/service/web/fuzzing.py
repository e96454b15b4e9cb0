"""Made-up requests of every role, on every operation of the published interface: no 5xx, nothing undocumented."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import httpx
import schemathesis
import uvicorn
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from schemathesis import GenerationMode
from sqlalchemy import update

from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.evaluation.records.store import seal, write_record
from dohyo.service.accounts.model import Role
from dohyo.service.app import create_app
from dohyo.service.database.base import now
from dohyo.service.episodes.archive import archived_path
from dohyo.service.evaluations.model import Episode, EpisodeStatus, EvaluationStatus
from dohyo.service.evaluations.scoring import summary_of
from dohyo.service.settings import Settings
from dohyo.service.worlds.live import steps
from tests.evaluation.builders import drive, ego, episode
from tests.service.harness import Harness, IdleScheduler, finish

CALLERS: Final[Mapping[str, tuple[str, Role] | None]] = {
    "anonymous": None,
    "reader": ("guest", Role.READER),
    "worker": ("owner", Role.WORKER),
    "submitter": ("stranger", Role.SUBMITTER),
    "owner": ("owner", Role.ORGANISER),
    "organiser": ("other-organiser", Role.ORGANISER),
    "admin": ("root", Role.ADMIN),
}
"""Owner and role of each caller; what exists is the owner's."""

WAITS: Final = ("/v1/workers/{worker_id}/acquire", "/v1/worlds/{identifier}/events")
"""Wait for an episode, or stream for ever; they have tests of their own."""
TOKEN: Final = "its own token"
LONGEST_ANSWER_S: Final = 120.0  # of a machine that does much else; Schemathesis's own is 10
LAST: Final = "/v1/worlds/{identifier}/end"


@contextmanager
def listening(data: Path) -> Iterator[tuple[str, Harness]]:
    """The service behind a real socket, since some requests that are made up exist only there."""
    generous = {"requests_per_minute": 1_000_000, "read_seconds_per_minute": 1e6, "_env_file": None}
    app = create_app(Settings(data=data, **generous), IdleScheduler)  # type: ignore[arg-type]
    steps.STEP_WAIT_S = 0.2  # a step in a world that another request has paused
    server = uvicorn.Server(uvicorn.Config(app, port=0, log_config=None, access_log=False, lifespan="on"))
    thread = threading.Thread(target=server.run)
    thread.start()
    while not server.started:
        assert thread.is_alive()
        time.sleep(0.01)
    url = f"http://127.0.0.1:{server.servers[0].sockets[0].getsockname()[1]}"
    try:
        with httpx.Client(base_url=url, timeout=LONGEST_ANSWER_S) as client:
            yield url, Harness(client, app.state.services)  # type: ignore[arg-type]
    finally:
        server.should_exit = True
        thread.join()


def find_faults(
    url: str,
    service: Harness,
    callers: list[str],
    examples: int,
    each: bool,
    only: str = "",
    told: Callable[[str], None] = lambda operation: None,
) -> list[str]:
    """Sends made-up requests, half of them about what exists.

    Args:
        url: Address of the service.
        service: The same service.
        callers: Names in `CALLERS`.
        examples: Cases of each operation.
        each: Whether every caller sends each case; otherwise one that is drawn.
        only: Part of the paths of the operations; "": all.
        told: Called with each operation before its cases.

    Returns:
        One line for each kind of fault.
    """
    headers = {name: _headers(service, name) for name in CALLERS}
    real = _resources(service, headers["owner"])
    schema = schemathesis.openapi.from_dict(service.client.get("/openapi.json").json())
    operations = [operation.ok() for operation in schema.get_all_operations()]
    assert len(operations) > 30
    chosen = [callers] if each else [[name] for name in callers]
    faults: set[str] = set()
    for operation in sorted(operations, key=lambda one: (one.method.upper() == "DELETE", one.path == LAST)):
        if operation.path not in WAITS and only in operation.path:
            told(f"{operation.method.upper()} {operation.path}")
            _try(url, operation, {name: headers[name] for name in callers}, chosen, real, examples, faults)
    return sorted(faults)


def _headers(service: Harness, name: str) -> dict[str, str]:
    held = CALLERS[name]
    return {} if held is None else {"authorization": f"Bearer {service.token(*held)}"}


def _resources(service: Harness, headers: dict[str, str]) -> dict[str, dict[str, Any]]:
    """Something of every kind; the parameters of its path by the path's beginning, the longest first."""

    def make(path: str, body: Any) -> Any:
        answer = service.client.post(path, json=body, headers=headers)
        assert answer.status_code < 300, answer.text
        return answer.json()

    make("/v1/agents", {"name": "mine"})
    make("/v1/agents/mine/submissions", {"kind": "remote"})
    evaluation = make("/v1/evaluations", {"agent": "mine", "benchmark": "quickstart", "seeds": [0]})["id"]
    driven = service.client.get(f"/v1/evaluations/{evaluation}/episodes", headers=headers).json()["items"][0]["id"]
    _drive(service, driven)
    finish(service.services.database, evaluation, EvaluationStatus.CANCELLED, EpisodeStatus.CANCELLED)
    make("/v1/challenges", {"name": "cup", "title": "Cup"})
    phase = {"name": "final", "benchmark": "quickstart", "runs_per_period": 3, "period_s": 3600.0}
    ranking = make("/v1/challenges/cup/phases", phase | {"closes": "2099-01-01T00:00:00Z"})["id"]
    baseline = make("/v1/challenges/cup/baselines", {"agent": "mine"})["submission"]
    invitation = make("/v1/challenges/cup/invitations", {})["id"]
    webhook = make("/v1/webhooks", {"url": "https://93.184.215.14/hook"})["id"]
    token = make("/v1/tokens", {"owner": "owner", "role": "reader"})["id"]
    worker = make("/v1/workers", {"agent": "mine"})
    world = make("/v1/worlds", {"network": "ingolstadt", "traffic": {"warm_up_s": 0.0}})["id"]
    seat = make(f"/v1/worlds/{world}/join", {"name": "simulator", "coupled": True})
    return {
        "/v1/challenges/{name}/phases": {"name": "cup", "identifier": ranking},
        "/v1/challenges/{name}/baselines": {"name": "cup", "identifier": baseline},
        "/v1/challenges/{name}/invitations": {"name": "cup", "identifier": invitation},
        "/v1/challenges": {"name": "cup"},
        "/v1/evaluations": {"identifier": evaluation},
        "/v1/episodes": {"identifier": driven},
        "/v1/networks": {"name": "ingolstadt"},
        "/v1/benchmarks": {"name": "quickstart"},
        "/v1/builtin-agents": {"name": "autopilot"},
        "/v1/agents": {"name": "mine", "version": 1},
        "/v1/rankings": {"identifier": ranking},
        "/v1/webhooks": {"identifier": webhook},
        "/v1/tokens": {"identifier": token},
        "/v1/workers": {"worker_id": worker.get("worker", "")},
        "/v1/worlds": {"identifier": world},
        "/v1/seats": {"seat": seat["seat"], TOKEN: seat["token"]},
    }


def _drive(service: Harness, identifier: str) -> None:
    """Ends an episode as if it had been driven, with a record."""
    scenario = load_benchmark("quickstart").scenarios([0])[0]
    record = seal(episode(ego(progress_m=100.0)).model_copy(update={"scenario": scenario}))
    path = archived_path(service.services.settings, record.record_hash)
    write_record(path.parent, path.stem, record, drive())
    facts = {"record_hash": record.record_hash, "kept_bytes": path.stat().st_size, "finished": now()}
    summary = json.loads(json.dumps(summary_of(record, "2.0")))
    with service.services.database.session() as session:
        done = facts | {"status": EpisodeStatus.DONE, "summary": summary}
        session.execute(update(Episode).where(Episode.id == identifier).values(**done))


def _try(
    url: str,
    operation: Any,
    headers: Mapping[str, dict[str, str]],
    chosen: list[list[str]],
    real: Mapping[str, dict[str, Any]],
    examples: int,
    faults: set[str],
) -> None:
    documented = {str(status) for status in operation.definition.raw["responses"]}
    exists = next((one for beginning, one in real.items() if operation.path.startswith(beginning)), {})

    @settings(
        max_examples=examples,
        deadline=None,
        database=None,
        derandomize=True,
        phases=[Phase.explicit, Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(
        case=st.one_of(*(operation.as_strategy(generation_mode=mode) for mode in GenerationMode)),
        existing=st.booleans(),
        callers=st.sampled_from(chosen),
    )
    def probe(case: Any, existing: bool, callers: list[str]) -> None:
        if existing and case.path_parameters:
            case.path_parameters.update({key: value for key, value in exists.items() if key in case.path_parameters})
        own = {"authorization": f"Bearer {exists[TOKEN]}"} if existing and TOKEN in exists else None
        for name in callers:
            answer = case.call(base_url=url, headers=own or headers[name], timeout=LONGEST_ANSWER_S)
            if fault := _fault(answer, documented):
                faults.add(f"{operation.method.upper()} {operation.path} as {name}: {answer.status_code} {fault}")

    probe()


def _fault(answer: Any, documented: set[str]) -> str:
    """What is wrong with an answer; "" if nothing is."""
    status = answer.status_code
    if status >= 500 and status not in (503, 507):
        return str(answer.text[:300])
    if str(status) not in documented:
        return "is not documented"
    kind = answer.headers.get("content-type")
    if status >= 400 and status != 416 and kind != ["application/problem+json"]:
        return f"is no problem document: {kind}"
    return ""
