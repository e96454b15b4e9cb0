"""The sandbox: what it gives up is really gone, and what a model does in it hurts nobody."""

from __future__ import annotations

import gc
import os
import platform
from pathlib import Path

import numpy as np
import onnx
import pytest

from dohyo.service.policies.interface import Tensor
from dohyo.service.policies.limits import PolicyLimits
from dohyo.service.policies.sandbox import Sandbox
from dohyo.sumo_networks.errors import AgentError, AgentTimeoutError
from tests.service.policies import models

# Long enough for a machine that is busy with other tests.
LIMITS = PolicyLimits(memory_mb=1024, load_s=60.0, decision_s=60.0)
INPUTS = (Tensor("speedometer", (2,), "float32"),)
SLOW = {"speedometer": np.array([1.0, 0.5], np.float32)}
FAST = {"speedometer": np.array([9.0, 0.5], np.float32)}

linux = pytest.mark.skipif(platform.system() != "Linux", reason="/proc is Linux's")
as_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root can become somebody else")


def start(model: onnx.ModelProto, limits: PolicyLimits = LIMITS, seed: int = 0) -> Sandbox:
    return Sandbox(model.SerializeToString(), INPUTS, limits, seed)


def running(pid: int) -> bool:
    return Path(f"/proc/{pid}").exists()


def status(pid: int) -> dict[str, str]:
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return {name: value.strip() for name, _, value in (line.partition(":") for line in lines)}


@linux
def test_the_process_holds_a_model_with_nothing_but_two_pipes() -> None:
    sandbox = start(models.identity())
    try:
        sandbox.decide(SLOW)
        own = status(sandbox.pid)
        assert (own["Threads"], own["Seccomp"], own["NoNewPrivs"]) == ("1", "2", "1")
        assert int(own["CapEff"], 16) == 0
        opened = [os.readlink(path) for path in Path(f"/proc/{sandbox.pid}/fd").iterdir()]
        assert {name.split(":")[0] for name in opened} <= {"pipe", "/dev/null"}
        limits = Path(f"/proc/{sandbox.pid}/limits").read_text()
        for line in ("Max file size 0", "Max processes 0", "Max open files 0", "Max address space 1024000000"):
            assert line in " ".join(limits.split())
        environment = Path(f"/proc/{sandbox.pid}/environ").read_bytes().split(b"\0")
        names = {entry.partition(b"=")[0] for entry in environment if entry}
        assert names == {b"OMP_NUM_THREADS", b"OPENBLAS_NUM_THREADS", b"ORT_DISABLE_TELEMETRY"}
        assert os.readlink(f"/proc/{sandbox.pid}/cwd").endswith("(deleted)")
    finally:
        sandbox.close()


@linux
@as_root
def test_root_becomes_nobody_in_an_empty_root_directory_and_network() -> None:
    sandbox = start(models.identity())
    try:
        assert status(sandbox.pid)["Uid"].split() == ["65534"] * 4
        assert status(sandbox.pid)["Groups"] == ""
        if sandbox.layers["own_network"]:
            assert os.readlink(f"/proc/{sandbox.pid}/ns/net") != os.readlink("/proc/self/ns/net")
        if sandbox.layers["empty_root"]:
            assert os.readlink(f"/proc/{sandbox.pid}/root").endswith("(deleted)")
    finally:
        sandbox.close()


def test_actions_are_those_of_numpy() -> None:
    model, weight, bias = models.linear()
    sandbox = start(model)
    rng = np.random.default_rng(0)
    try:
        for _ in range(20):
            speedometer = rng.normal(size=2).astype(np.float32)
            action = sandbox.decide({"speedometer": speedometer})
            assert action.dtype == np.float32
            np.testing.assert_allclose(action, np.tanh(speedometer @ weight + bias), rtol=1e-5)
    finally:
        sandbox.close()


def test_a_state_is_zero_at_the_start_and_kept_between_decisions() -> None:
    for _ in range(2):
        sandbox = start(models.counter())
        sums = [sandbox.decide(SLOW).tolist() for _ in range(3)]
        sandbox.close()
        assert sums == [[1.0, 0.5], [2.0, 1.0], [3.0, 1.5]]


def test_random_operators_follow_the_seed() -> None:
    def drawn(seed: int) -> list[list[float]]:
        sandbox = start(models.noise(), seed=seed)
        numbers = [sandbox.decide(SLOW).tolist() for _ in range(3)]
        sandbox.close()
        return numbers

    assert drawn(1) == drawn(1) != drawn(2)
    assert drawn(1)[0] != drawn(1)[1]


def test_a_large_image_goes_through() -> None:
    image = Tensor("speedometer", (600, 800, 3), "uint8")
    nodes = [
        onnx.helper.make_node("Cast", ["speedometer"], ["float"], to=onnx.TensorProto.FLOAT),
        onnx.helper.make_node("ReduceMean", ["float"], ["action"], axes=[0, 1], keepdims=0),
    ]
    model = models.model(
        nodes, inputs={"speedometer": image.shape}, outputs={"action": (3,)}, dtype=onnx.TensorProto.UINT8
    )
    sandbox = Sandbox(model.SerializeToString(), (image,), LIMITS, 0)
    try:
        pixels = np.broadcast_to(np.array([10, 20, 30], np.uint8), image.shape)
        assert sandbox.decide({"speedometer": pixels}).tolist() == [10.0, 20.0, 30.0]
    finally:
        sandbox.close()


def test_an_endless_loop_is_ended_at_the_deadline() -> None:
    sandbox = start(models.triggered(models.endless()), PolicyLimits(memory_mb=1024, decision_s=1.0))
    with pytest.raises(AgentTimeoutError, match="a decision took longer than 1 s"):
        sandbox.decide(FAST)
    assert not running(sandbox.pid)
    with pytest.raises(AgentError, match="has ended"):
        sandbox.decide(SLOW)


def test_too_much_processor_time_is_named() -> None:
    sandbox = start(models.triggered(models.endless()), PolicyLimits(cpu_s=1, decision_s=60.0))
    with pytest.raises(AgentError, match="used more than 1 s of processor time"):
        sandbox.decide(FAST)


@pytest.mark.parametrize("bomb", [models.huge_constant(), models.doubling()], ids=["constant", "doubling"])
def test_a_memory_bomb_ends_only_the_policy(bomb: onnx.ModelProto) -> None:
    sandbox = start(models.triggered(bomb), PolicyLimits(memory_mb=1024, decision_s=60.0))
    assert sandbox.decide(SLOW).tolist() == SLOW["speedometer"].tolist()
    with pytest.raises(AgentError, match="more than the 1024 MB of memory"):
        sandbox.decide(FAST)
    assert not running(sandbox.pid)


def test_a_process_that_dies_is_an_error_and_no_hang() -> None:
    sandbox = start(models.identity())
    os.kill(sandbox.pid, 9)
    with pytest.raises(AgentError, match="SIGKILL"):
        sandbox.decide(SLOW)


def test_a_deadline_further_up_leaves_no_late_answer_behind(monkeypatch: pytest.MonkeyPatch) -> None:
    sandbox = start(models.identity())

    def interrupted(*_: object) -> bytes:
        raise KeyboardInterrupt

    monkeypatch.setattr("dohyo.service.confinement.process.ConfinedProcess.receive", interrupted)
    with pytest.raises(KeyboardInterrupt):
        sandbox.decide(SLOW)
    monkeypatch.undo()
    with pytest.raises(AgentError, match="has ended"):
        sandbox.decide(FAST)


def test_no_process_is_left_where_nobody_closes_it() -> None:
    sandbox = start(models.identity())
    pid = sandbox.pid
    assert running(pid)
    del sandbox
    gc.collect()
    assert not running(pid)


def test_a_model_that_cannot_be_loaded_leaves_no_process() -> None:
    before = set(children())
    with pytest.raises(AgentError):
        Sandbox(b"\x08\x09", INPUTS, LIMITS, 0)
    assert set(children()) <= before


def test_bytes_of_onnxruntimes_own_format_are_not_read_as_such() -> None:
    with pytest.raises(AgentError, match=r"(?i)protobuf"):
        Sandbox(b"\x18\x00\x00\x00ORTM" + bytes(100), INPUTS, LIMITS, 0)


def children() -> list[int]:
    """Pids of this process's children."""
    text = Path(f"/proc/self/task/{os.getpid()}/children").read_text()
    return [int(pid) for pid in text.split()]
