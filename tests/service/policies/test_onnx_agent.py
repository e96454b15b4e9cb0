"""OnnxPolicy drives: same bytes, same record; and what goes wrong is the agent's fault."""

from __future__ import annotations

import hashlib
import json
from importlib.metadata import version
from pathlib import Path

import numpy as np
import onnx
import pytest

from dohyo.evaluation.agent import AgentSpec, agent_info, make_agent
from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.evaluation.episode.runner import run_episode
from dohyo.evaluation.families import FORECASTING_CONTROL, PARKING_CONTROL, PLANNING_CONTROL
from dohyo.evaluation.records.record import EpisodeRecord
from dohyo.evaluation.records.specifications import Status
from dohyo.service.confinement.errors import ConfinementError
from dohyo.service.forecasting.interface import SENSORS as FORECASTING_SENSORS
from dohyo.service.freeway.planner import STATE
from dohyo.service.parking.interface import SENSORS as PARKING_SENSORS
from dohyo.service.policies.agent import ENTRY, FOLDER_VARIABLE, OnnxPolicy
from dohyo.service.policies.checks import PolicyRefusedError
from dohyo.service.policies.interface import observation_spec, published_spec
from dohyo.service.policies.limits import PolicyLimits
from dohyo.sumo_networks.ego.control import CONTROLS
from dohyo.sumo_networks.errors import AgentError, InvalidInputError
from dohyo.sumo_networks.scenario import Mission, Place, Scenario
from dohyo.sumo_networks.sensors import SENSORS as ALL_SENSORS
from examples.onnx_policy import SENSORS, export
from tests.service.policies import models

SCENARIO = Scenario(
    network="ingolstadt",
    missions=(
        Mission(start=Place(lane="737320747#3_2", position_m=20.0), goal=Place(lane="737320747#4_2", position_m=60.0)),
    ),
    seed=4,
)
OBSERVATION = {"speedometer": np.array([1.0, 0.5], np.float32)}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    return tmp_path


def stored(folder: Path, content: bytes) -> str:
    sha256 = hashlib.sha256(content).hexdigest()
    (folder / f"{sha256}.onnx").write_bytes(content)
    return sha256


def drive(agent: OnnxPolicy, scenario: Scenario = SCENARIO) -> EpisodeRecord:
    try:
        infos = {"ego": agent_info(agent, ENTRY, agent.settings)}
        return run_episode(scenario, {"ego": agent}, infos=infos)
    finally:
        agent.close()


def test_nothing_of_the_scenarios_seed_reaches_the_model() -> None:
    """It could tell a hidden seed by the time that it takes: the next run of its owner would know the scenario."""

    def drawn(seed: int) -> list[list[float]]:
        agent = OnnxPolicy(content=models.noise().SerializeToString(), sensors=("speedometer",))
        agent.reset(SCENARIO.missions[0], seed)
        numbers = [agent.act(OBSERVATION).tolist() for _ in range(3)]
        agent.close()
        return numbers

    assert drawn(1) == drawn(2)
    assert drawn(1)[0] != drawn(1)[1]


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore:.*TracerWarning")
def test_the_example_reaches_its_goal_and_gives_the_same_record_wherever_its_file_lies(
    folder: Path, tmp_path: Path
) -> None:
    path = tmp_path / "policy.onnx"
    export(str(path))
    (scenario, *_) = load_benchmark("quickstart").scenarios([0])
    scenario = scenario.model_copy(update={"missions": SCENARIO.missions, "stop_on_collision": False})
    stored(folder, path.read_bytes())
    own = OnnxPolicy(path=path, name="pursuit", track="privileged", sensors=SENSORS)
    first = drive(own, scenario)
    again = drive(make_agent(ENTRY, json.loads(json.dumps(own.settings))), scenario)  # type: ignore[arg-type]
    assert first.egos[0].status.completed
    assert first.record_hash == again.record_hash
    assert str(tmp_path) not in first.model_dump_json()


def test_the_observation_is_the_models_and_the_batch_dimension_is_taken_off() -> None:
    model = models.identity(inputs={"speedometer": (1, 2)}, outputs={"action": (1, 2)})
    agent = OnnxPolicy(content=model.SerializeToString(), sensors=["speedometer"])
    agent.reset(SCENARIO.missions[0], 0)
    assert agent.act(OBSERVATION).tolist() == [1.0, 0.5]
    agent.close()


def test_nothing_of_one_episode_is_left_in_the_next() -> None:
    agent = OnnxPolicy(content=models.counter().SerializeToString(), sensors=["speedometer"])
    for _ in range(2):
        agent.reset(SCENARIO.missions[0], 0)
        assert [agent.act(OBSERVATION)[0] for _ in range(2)] == [1.0, 2.0]
    agent.close()
    with pytest.raises(AgentError, match="was not reset"):
        agent.act(OBSERVATION)


def nan() -> onnx.ModelProto:
    return models.model([onnx.helper.make_node("Div", ["speedometer", "zero"], ["action"])], constants=ZERO)


def other_interface() -> onnx.ModelProto:
    return models.model([onnx.helper.make_node("Identity", ["speed"], ["action"])], inputs={"speed": (2,)})


ZERO = {"zero": np.zeros(2, np.float32)}


@pytest.mark.parametrize(
    ("model", "decision_s", "status", "says"),
    [
        (nan(), 60.0, Status.AGENT_ACTION, "expected finite numbers"),
        (models.endless(), 0.5, Status.AGENT_DEADLINE, "a decision took longer than 0.5 s"),
        (models.huge_constant(), 60.0, Status.AGENT_RAISED, "more than the 2048 MB of memory"),
        (other_interface(), 60.0, Status.AGENT_SETUP, "no input 'speedometer'"),
    ],
    ids=["nan", "endless", "bomb", "another interface"],
)
def test_what_goes_wrong_is_the_agents_fault(
    folder: Path, model: onnx.ModelProto, decision_s: float, status: Status, says: str
) -> None:
    sha256 = stored(folder, model.SerializeToString())
    record = drive(OnnxPolicy(sha256, sensors=["speedometer"], limits=PolicyLimits(decision_s=decision_s)))
    (ego,) = record.egos
    assert ego.status is status
    assert says in (ego.failure or "")


def test_a_file_that_was_exchanged_is_not_driven(folder: Path) -> None:
    sha256 = stored(folder, models.identity().SerializeToString())
    (folder / f"{sha256}.onnx").write_bytes(models.counter().SerializeToString())
    with pytest.raises(InvalidInputError, match=f"expected a file with sha256 {sha256}"):
        OnnxPolicy(sha256, sensors=["speedometer"])


@pytest.mark.parametrize("sha256", ["", "../../etc/passwd", "0" * 63, "0" * 64 + "\n"])
def test_only_a_hash_names_a_stored_policy(folder: Path, sha256: str) -> None:
    with pytest.raises(InvalidInputError, match="64 hexadecimal digits"):
        OnnxPolicy(sha256)


def test_a_policy_that_is_not_there_is_named(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InvalidInputError, match="No such file"):
        OnnxPolicy("0" * 64)
    monkeypatch.delenv(FOLDER_VARIABLE)
    with pytest.raises(InvalidInputError, match=FOLDER_VARIABLE):
        OnnxPolicy("0" * 64)


def test_a_file_of_ones_own_is_checked() -> None:
    with pytest.raises(PolicyRefusedError, match="a pickle"):
        OnnxPolicy(content=b"\x80\x04\x95" + bytes(20), sensors=["speedometer"])


def test_the_published_document_covers_every_sensor_and_control_in_plain_json() -> None:
    document = published_spec()
    assert json.loads(json.dumps(document, allow_nan=False)) == document
    assert set(document["sensors"]) == {*ALL_SENSORS, *PARKING_SENSORS, *FORECASTING_SENSORS, STATE}
    assert set(document["controls"]) == {*CONTROLS, PARKING_CONTROL, FORECASTING_CONTROL, PLANNING_CONTROL}
    assert all(entry["description"] and entry["shape"] for entry in document["sensors"].values())
    speedometer = document["sensors"]["speedometer"]
    assert (speedometer["shape"], speedometer["low"], speedometer["high"]) == ([2], [0.0, -1.0], [100.0, 1.0])
    assert "[m/s]" in speedometer["description"]


def test_the_document_of_a_spec_names_what_to_upload() -> None:
    document = observation_spec(AgentSpec(name="x", sensors=("route", "speedometer"), control="waypoints"))
    assert [entry["name"] for entry in document["inputs"]] == ["route", "speedometer"]
    assert document["inputs"][0]["low"] is None
    assert (document["outputs"][0]["name"], document["outputs"][0]["shape"]) == ("action", [8, 2])
    with pytest.raises(InvalidInputError, match="needs track 'privileged'"):
        observation_spec(AgentSpec(name="x", sensors=("objects",)))


def test_a_sandbox_that_cannot_be_started_is_not_the_agents_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise ConfinementError("this machine cannot confine a policy: no namespaces")

    monkeypatch.setattr("dohyo.service.policies.agent.Sandbox", refuse)
    record = drive(OnnxPolicy(content=models.identity().SerializeToString(), sensors=["speedometer"]))
    (ego,) = record.egos
    assert ego.status is Status.SIMULATION
    assert ego.status.worth_another_try
    assert "cannot confine" in (ego.failure or "")


def test_a_record_says_which_onnxruntime_and_another_one_does_not_drive() -> None:
    content = models.identity().SerializeToString()
    policy = OnnxPolicy(content=content, sensors=["speedometer"])
    assert policy.settings["onnxruntime"] == version("onnxruntime")
    OnnxPolicy(content=content, sensors=["speedometer"], onnxruntime=version("onnxruntime"))
    with pytest.raises(InvalidInputError, match=r"submitted for onnxruntime 1\.0\.0, here is .*; submit it again"):
        OnnxPolicy(content=content, sensors=["speedometer"], onnxruntime="1.0.0")
