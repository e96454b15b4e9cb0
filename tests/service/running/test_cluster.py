"""`dohyo serve --executor ray`: episodes on a Ray cluster give the records of this machine's processes."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from onnx import helper

from dohyo.evaluation.agent import agent_info
from dohyo.service.evaluations.model import EvaluationStatus
from dohyo.service.policies.agent import ENTRY, OnnxPolicy
from dohyo.service.submissions.model import AgentKind
from dohyo.sumo_networks.errors import InvalidInputError
from tests.evaluation.agents import Steady, kill_the_actor
from tests.service.mixed_runs.test_records import TWO
from tests.service.policies import models
from tests.service.served import STEADY, Service, info_of, short
from tests.service.serving import command
from tests.service.workers.wire_worker import hire

pytestmark = pytest.mark.slow

HEAD = """
import ray, sys
from dohyo.evaluation.running.ray_executor import LOCAL_CLUSTER
begun = ray.init(num_cpus=1, log_to_driver=False, logging_level="error", **LOCAL_CLUSTER)
print(begun.address_info["gcs_address"], flush=True)
sys.stdin.read()
ray.shutdown()
"""


class KillsItsStationOnce(Steady):
    """Ends the Ray actor above its worker process, as the loss of a machine does."""

    def __init__(self, marker: str) -> None:
        super().__init__(after=10)
        self.marker = Path(marker)

    def misbehave(self) -> np.ndarray:
        if not self.marker.exists():
            self.marker.touch()
            kill_the_actor()
        return np.array([6.0, 0.0])


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    """A cluster in a process of its own."""
    pytest.importorskip("ray", reason="Ray is not installed (pip install 'dohyo[cluster]')")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RAY_AUTH_MODE", "token")  # for all that is started below, or strangers could join
        begin = [sys.executable, "-c", HEAD]
        with subprocess.Popen(begin, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as head:
            assert head.stdout is not None
            yield head.stdout.readline().strip()


@pytest.fixture(scope="module")
def service(address: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    shared = Service(tmp_path_factory.mktemp("data"), processes=1, executor="ray", ray_address=address)
    shared.start()
    yield shared
    shared.close()


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """The same on this machine's processes."""
    local = Service(tmp_path_factory.mktemp("local"), processes=1)
    local.start()
    yield local
    local.close()


def ahead(service: Service) -> OnnxPolicy:
    """A policy that always wants 6 m/s, uploaded to a service."""
    nodes = [
        helper.make_node("Mul", ["speedometer", "none"], ["nothing"]),
        helper.make_node("Add", ["nothing", "wish"], ["action"]),
    ]
    constants = {"none": np.zeros(2, np.float32), "wish": np.array([6.0, 0.0], np.float32)}
    policy = OnnxPolicy(content=models.model(nodes, constants=constants).SerializeToString(), sensors=("speedometer",))
    service.settings.policies.mkdir(exist_ok=True)
    (service.settings.policies / f"{policy.sha256}.onnx").write_bytes(policy._content)
    return policy


def test_built_in_and_uploaded_agents_give_the_same_records(service: Service, here: Service) -> None:
    found = []
    for one in (service, here):
        policy = ahead(one)
        uploaded = agent_info(policy, ENTRY, policy.settings)
        orders = [
            one.submit(info_of(STEADY), short(2), kind=AgentKind.BUILTIN),
            one.submit(uploaded, short(), kind=AgentKind.ONNX),
            one.submit(info_of(STEADY), TWO, kind=AgentKind.BUILTIN, others={"front": uploaded}),
        ]
        found.append([one.hashes(order) for order in orders])
    assert found[0] == found[1]
    assert len({*found[0][0], *found[0][1], *found[0][2]}) == 4


def test_a_policy_worker_drives_in_a_process_of_the_service_all_the_same(service: Service, here: Service) -> None:
    found = []
    for one in (service, here):
        info = info_of(STEADY).model_copy(update={"name": "remote"})
        order = one.submit(info, short())
        worker = hire(one, "remote")
        worker.drive(worker.acquire(60.0))
        found.append(one.hashes(order))
        worker.close()
    assert found[0] == found[1]


def test_what_the_cluster_loses_is_driven_again(service: Service, tmp_path: Path) -> None:
    marker = tmp_path / "marker"
    info = info_of(f"{__name__}:KillsItsStationOnce", marker=str(marker))
    order = service.submit(info.model_copy(update={"name": "kills"}), short(), kind=AgentKind.BUILTIN)
    assert service.wait(order).status is EvaluationStatus.DONE
    assert marker.exists()
    assert [one.attempts for one in service.episodes(order)] == [2]


def test_an_agent_whose_code_has_changed_does_not_drive(service: Service) -> None:
    info = info_of(STEADY).model_copy(update={"name": "changed", "source_sha256": "0" * 64})
    ended = service.wait(service.submit(info, short(), kind=AgentKind.BUILTIN))
    assert ended.status is EvaluationStatus.FAILED
    assert "its code has changed" in (ended.failure or "")


def test_without_a_cluster_the_service_does_not_start(tmp_path: Path) -> None:
    pytest.importorskip("ray", reason="Ray is not installed (pip install 'dohyo[cluster]')")
    options = ("--executor", "ray", "--ray-address", "127.0.0.1:9")
    done = command("serve", "--port", "0", "--data", str(tmp_path / "data"), *options)
    assert isinstance(done.exception, InvalidInputError)
    assert "no Ray cluster at '127.0.0.1:9'" in str(done.exception)
    assert not (tmp_path / "data").exists()  # nor was a first token made that nobody has seen
