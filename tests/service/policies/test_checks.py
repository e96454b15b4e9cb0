"""Uploads: what may drive passes, everything else is refused in one line that says why."""

from __future__ import annotations

import gzip
import hashlib
import io
import pickle
import tarfile
from collections.abc import Callable

import numpy as np
import onnx
import pytest
import torch
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from onnx import TensorProto, helper, numpy_helper
from safetensors.numpy import save

from dohyo.evaluation.agent import AgentSpec
from dohyo.service.policies.checks import PolicyInfo, PolicyRefusedError, check_policy
from dohyo.service.policies.inspection import inspect_model
from dohyo.service.policies.limits import PolicyLimits
from dohyo.sumo_networks.errors import InvalidInputError
from tests.service.policies import models

# Long enough for a machine that is busy with other tests.
LIMITS = PolicyLimits(memory_mb=1024, load_s=60.0, decision_s=60.0)


def check(model: onnx.ModelProto | bytes, spec: AgentSpec = models.SPEC, limits: PolicyLimits = LIMITS) -> PolicyInfo:
    content = model if isinstance(model, bytes) else model.SerializeToString()
    return check_policy(content, spec, limits)


def refusal(model: onnx.ModelProto | bytes, limits: PolicyLimits = LIMITS) -> str:
    with pytest.raises(PolicyRefusedError) as caught:
        check(model, limits=limits)
    message = str(caught.value)
    assert "\n" not in message
    assert len(message) < 700
    return message


def test_an_honest_model_passes_and_is_described() -> None:
    model, _, _ = models.linear()
    info = check(model)
    assert info.sha256 == hashlib.sha256(model.SerializeToString()).hexdigest()
    assert (info.nodes, info.opset, info.ir_version, info.states) == (3, 17, 9, {})


def test_a_recurrent_model_passes_with_the_shapes_of_its_states() -> None:
    assert check(models.counter()).states == {"state_sum": (1, 2)}


FORGED = "x\ndohyo: all is well"


@pytest.mark.parametrize(
    "model",
    [
        models.identity(inputs={**models.SPEEDOMETER, FORGED: (2,)}),
        models.identity(outputs={**models.ACTION, FORGED: (2,)}),
        models.identity(inputs={FORGED: (2,)}),
        models.identity(inputs={**models.SPEEDOMETER, f"state_{FORGED}": (2,)}),
    ],
)
def test_a_line_break_in_a_name_is_told_as_such(model: onnx.ModelProto) -> None:
    assert r"x\ndohyo: all is well'" in refusal(model)


@pytest.mark.parametrize("batch", [1, "batch", None])
def test_a_leading_batch_dimension_is_allowed(batch: int | str | None) -> None:
    check(models.identity(inputs={"speedometer": (batch, 2)}, outputs={"action": (batch, 2)}))


def torch_script() -> bytes:
    buffer = io.BytesIO()
    torch.save({"weight": torch.zeros(2)}, buffer)
    return buffer.getvalue()


def tar() -> bytes:
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w") as archive:
        info = tarfile.TarInfo("model.onnx")
        info.size = 4
        archive.addfile(info, io.BytesIO(b"onnx"))
    return buffer.getvalue()


def npy() -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, np.zeros(2))
    return buffer.getvalue()


@pytest.mark.parametrize(
    ("make", "says"),
    [
        *((lambda p=p: pickle.dumps({"a": [1, 2]}, p), "a pickle") for p in range(6)),
        (lambda: pickle.dumps(print, 0), "a pickle"),
        (torch_script, "a ZIP archive, as torch.save"),
        (tar, "a tar archive"),
        (lambda: gzip.compress(models.identity().SerializeToString()), "compressed with gzip"),
        (lambda: b"\x89HDF\r\n\x1a\n" + bytes(100), "an HDF5 file"),
        (lambda: save({"weight": np.zeros(2)}), "a safetensors file"),
        (npy, "a numpy array"),
        (lambda: b"import os\nos.system('true')\n", "a text, such as source code"),
        (lambda: b"\x18\x00\x00\x00ORTM" + bytes(100), "in onnxruntime's own format"),
        (lambda: b"\x7fELF" + bytes(100), "a program"),
    ],
)
def test_what_is_no_onnx_is_named_and_the_way_to_onnx_told(make: Callable[[], bytes], says: str) -> None:
    message = refusal(make())
    assert says in message
    assert "torch.onnx.export" in message


def test_an_empty_file_is_refused() -> None:
    assert refusal(b"") == "the file is empty"


def test_a_file_above_the_limit_is_refused_before_it_is_looked_at() -> None:
    assert refusal(bytes(2_000_001), PolicyLimits(file_mb=2)) == "the file has 3 MB, at most 2 MB are taken"


def test_a_truncated_model_is_refused() -> None:
    content = models.linear()[0].SerializeToString()
    assert "cut off" in refusal(content[: len(content) // 2])


def with_constant(tensor: TensorProto) -> onnx.ModelProto:
    node = helper.make_node("Constant", [], ["c"], value=tensor)
    return models.model([node, helper.make_node("Add", ["speedometer", "c"], ["action"])])


def two(name: str = "w") -> TensorProto:
    return numpy_helper.from_array(np.ones(2, np.float32), name)


def external_initializer() -> onnx.ModelProto:
    model = models.linear()[0]
    models.external(model.graph.initializer[0])
    return model


def external_in_a_branch() -> onnx.ModelProto:
    return models.triggered(with_constant(models.external(two("hidden"))))


def external_in_a_function() -> onnx.ModelProto:
    body = [helper.make_node("Constant", [], ["y"], value=models.external(two("hidden")))]
    function = helper.make_function("ai.onnx.ml", "F", [], ["y"], body, [helper.make_opsetid("", 17)])
    return models.identity(functions=[function])


def external_sparse() -> onnx.ModelProto:
    sparse = helper.make_sparse_tensor(models.external(two("hidden")), numpy_helper.from_array(np.array([0, 1])), [2])
    model = models.identity()
    model.graph.sparse_initializer.append(sparse)
    return model


@pytest.mark.parametrize(
    "make",
    [
        external_initializer,
        external_in_a_branch,
        external_in_a_function,
        external_sparse,
        lambda: with_constant(models.external(two(), "../../secret")),
    ],
)
def test_external_data_is_refused_wherever_it_is(make: Callable[[], onnx.ModelProto]) -> None:
    assert "is kept in another file" in refusal(make())


def foreign_in_a_branch() -> onnx.ModelProto:
    node = helper.make_node("Gelu", ["speedometer"], ["action"], domain="com.microsoft")
    return models.triggered(models.model([node]))


def foreign_function() -> onnx.ModelProto:
    body = [helper.make_node("Identity", ["x"], ["y"])]
    function = helper.make_function("mine", "F", ["x"], ["y"], body, [helper.make_opsetid("", 17)])
    return models.identity(functions=[function])


@pytest.mark.parametrize(("make", "domain"), [(foreign_in_a_branch, "com.microsoft"), (foreign_function, "mine")])
def test_foreign_domains_are_refused_wherever_they_are(make: Callable[[], onnx.ModelProto], domain: str) -> None:
    assert f"of the domain '{domain}'" in refusal(make())


def test_nodes_are_bounded_with_those_of_subgraphs() -> None:
    model = models.endless()
    assert refusal(model, PolicyLimits(nodes=4)) == "it has 5 nodes, at most 4 are taken"


def texts() -> onnx.ModelProto:
    model = models.identity()
    model.graph.initializer.append(helper.make_tensor("t", TensorProto.STRING, [1], [b"text"]))
    return model


@pytest.mark.parametrize(
    ("model", "says"),
    [
        (models.identity(inputs={"speed": (2,)}), "no input 'speedometer', of shape (2); it has 'speed'"),
        (models.identity(outputs={"actions": (2,)}), "no output 'action', of shape (2); it has 'actions'"),
        (models.identity(inputs={"speedometer": (3,)}), "expected shape (2) or (1, 2), got (3)"),
        (models.identity(inputs={"speedometer": (4, 2)}), "expected shape (2) or (1, 2), got (4, 2)"),
        (models.identity(inputs={"speedometer": (None,)}), "expected shape (2) or (1, 2), got (?)"),
        (models.identity(outputs={"action": (2, 1)}), "output 'action': expected shape (2) or (1, 2), got (2, 1)"),
        (models.identity(dtype=TensorProto.DOUBLE), "input 'speedometer': expected float32, got float64"),
        (models.identity(inputs={"speedometer": (2,), "route": (80, 7)}), "input 'route' is no sensor of this agent"),
        (models.identity(outputs={"action": (2,), "value": (1,)}), "output 'value' is neither 'action' nor"),
        (models.identity(inputs={"speedometer": (2,), "state_h": (2,)}), "'state_h' has no output 'next_state_h'"),
        (models.counter(state=("n", 2)), "input 'state_sum': expected a fixed shape, got (?, 2)"),
        (models.counter(following=(2, 2)), "'next_state_sum': expected float32 of shape (1, 2), got float32 of shape"),
        (models.counter(state=(1_000_000, 2), following=(1_000_000, 2)), "its states hold 2000000 numbers"),
        (texts(), "holds tensors of type string"),
        (models.identity(opset_imports=[helper.make_opsetid("", 6)]), "written for opset 6; expected 7 or later"),
        (models.identity(opset_imports=[helper.make_opsetid("", 1000)]), "a trial decision failed: ONNX Runtime only"),
        (models.identity(ir_version=1000), "a trial decision failed: Unsupported model IR version"),
    ],
)
def test_another_interface_is_refused_with_what_was_expected(model: onnx.ModelProto, says: str) -> None:
    assert says in refusal(model)


def test_a_declared_shape_that_is_a_lie_is_found_by_the_trial() -> None:
    twice = models.model([helper.make_node("Concat", ["speedometer", "speedometer"], ["action"], axis=0)])
    assert "a trial decision" in refusal(twice)


@pytest.mark.parametrize("bomb", [models.huge_constant(), models.doubling()], ids=["constant", "doubling"])
def test_a_memory_bomb_is_refused(bomb: onnx.ModelProto) -> None:
    assert "needs more than the 1024 MB of memory" in refusal(bomb)


def test_an_endless_loop_is_refused() -> None:
    assert "a decision took longer than 0.5 s" in refusal(models.endless(), PolicyLimits(decision_s=0.5))


def test_an_unknown_sensor_is_the_callers_mistake() -> None:
    with pytest.raises(InvalidInputError, match="no sensor named 'speedo'"):
        check(models.identity(), AgentSpec(name="x", sensors=("speedo",)))


@settings(max_examples=12, suppress_health_check=[HealthCheck.too_slow])
@given(st.binary(max_size=300))
@example(bytes.fromhex("0809"))
@example(b"\x08" + b"\xff" * 50)
def test_no_bytes_do_anything_but_pass_or_be_refused(content: bytes) -> None:
    refusal(content)


@given(st.data())
def test_a_damaged_model_is_described_or_no_model(data: st.DataObject) -> None:
    content = bytearray(models.triggered(models.endless()).SerializeToString())
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    try:
        description = inspect_model(bytes(content))
    except ValueError as error:
        description = {"error": str(error)}
    assert description.get("nodes", 0) > 0 or "no ONNX model" in description["error"]


def last_rows(columns: int | str) -> onnx.ModelProto:
    """A forecaster: the last three minutes come again."""
    constants = {"starts": np.array([5]), "ends": np.array([8])}
    node = helper.make_node("Slice", ["history", "starts", "ends"], ["forecast"])
    shapes = {"inputs": {"history": (8, columns)}, "outputs": {"forecast": (3, columns)}}
    return models.model([node], constants=constants, **shapes)


def test_a_forecaster_may_leave_the_number_of_segments_open() -> None:
    spec = AgentSpec(name="f", track="sensors", sensors=("history",), control="speeds_ahead")
    for columns in (21, "segments"):
        assert check_policy(last_rows(columns).SerializeToString(), spec).nodes == 1
    with pytest.raises(PolicyRefusedError, match=r"input 'history': expected shape \(8, 21\).*got \(8, 20\)"):
        check_policy(last_rows(20).SerializeToString(), spec)
