"""Agents of parking on the benchmarks: the expert, and an exported policy."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from dohyo.agents.learning.networks.policy import Actor, EncodedPolicy
from dohyo.agents.learning.policies.export import export
from dohyo.agents.learning.tasks.task import named
from dohyo.agents.parking.policy_agent import PolicyAgent
from dohyo.agents.parking.training.features import FEATURES, KartFeatures
from dohyo.agents.parking.training.guided import forward_actions
from dohyo.evaluation.parking.agent import make_parking_agent
from dohyo.evaluation.parking.benchmark import load_parking_benchmark
from dohyo.evaluation.parking.drive import drive_lots
from dohyo.evaluation.records.record import AgentInfo
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.parking.observation import observation_space

ENTRY = "dohyo.agents.parking.expert.agent:ExpertAgent"


def test_the_expert_parks_three_karts_by_the_rules_of_the_benchmark():
    benchmark = load_parking_benchmark("parking-three")
    agents = [make_parking_agent(ENTRY) for _ in range(benchmark.karts)]
    spec = agents[0].spec
    info = AgentInfo(
        name=spec.name, kind="builtin", entry=ENTRY, settings={}, track=spec.track, sensors=spec.sensors,
        control=spec.control,
    )  # fmt: skip
    for drive in drive_lots(benchmark, benchmark.seeds[:2], agents, info):
        assert all(kart.ending == "parked" and kart.aligned for kart in drive.record.karts)


def test_an_exported_policy_drives_as_it_was_trained(tmp_path):
    torch.manual_seed(0)
    space, actions = observation_space(), forward_actions()
    actor = Actor(FEATURES, torch.as_tensor(actions.low), torch.as_tensor(actions.high), (8,))
    policy = EncodedPolicy(KartFeatures(), actor)
    export(policy, named(space), tmp_path / "policy", {})
    agent = PolicyAgent(tmp_path / "policy.onnx")
    seen = np.random.default_rng(0).uniform(-1.0, 1.0, space.shape).astype(np.float32)
    expected = policy({"observation": torch.from_numpy(seen[None])})[0].detach().numpy()
    assert agent.act(seen) == pytest.approx(expected, abs=1e-5)
    assert actions.contains(agent.act(seen))


def test_a_missing_policy_is_named():
    with pytest.raises(InvalidInputError, match=r"no policy 'missing\.onnx'"):
        make_parking_agent("dohyo.agents.parking.policy_agent:PolicyAgent", {"policy": "missing.onnx"})
