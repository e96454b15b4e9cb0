"""The evaluation of predictors, on samples whose errors are known."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dohyo.agents.mcts.predictors import evaluate
from dohyo.agents.mcts.predictors.constant_velocity import ConstantVelocity
from dohyo.agents.mcts.predictors.dataset import Sample, Shard
from dohyo.agents.mcts.predictors.evaluate import errors_of, measures, miss_cases, report, table
from dohyo.sumo_networks.world import ActorKind
from tests.agents.mcts.predictors.scenes import Body, busy, sampled, scene


def off_by(sample: Sample, metres: float) -> Sample:
    """The same, but everybody drove a metre more for every second."""
    ahead = (np.arange(16) + 1) * 0.5 * metres
    future, ego = sample.actors_future.copy(), sample.ego_future.copy()
    future[:, :, 0] += ahead
    ego[:, 0] += ahead
    return replace(sample, actors_future=future, ego_future=ego)


def shards(folder: Path, *episodes: list[Sample]) -> list[Path]:
    (folder / "test").mkdir(exist_ok=True)
    paths = [folder / "test" / f"{number}.npz" for number in range(len(episodes))]
    for path, samples in zip(paths, episodes, strict=True):
        path.write_bytes(Shard.of(samples).to_bytes())
    return paths


def test_errors_by_hand(tmp_path):
    now = scene([Body(10.0, 0.0, speed=5.0), Body(20.0, 5.0, speed=1.0, kind=ActorKind.PEDESTRIAN)], ego_speed=4.0)
    found = measures(errors_of(ConstantVelocity(), shards(tmp_path, [sampled(now)], [off_by(sampled(now), 1.0)])))
    assert found["ego: FDE at 8 s"] == pytest.approx([0.0, 8.0], abs=1e-4)
    assert found["neighbours: FDE at 3 s"] == pytest.approx([0.0, 3.0], abs=1e-4)
    assert found["neighbours: ADE at 1 s"] == pytest.approx([0.0, 0.75], abs=1e-4)
    assert found["vehicles that move: miss %"] == [0.0, 100.0]
    assert found["bicycles: miss %"] == []


def test_agents_not_seen_to_the_end_do_not_count(tmp_path):
    sample = off_by(sampled(scene([Body(10.0, 0.0), Body(20.0, 0.0)])), 1.0)
    sample.actors_future_valid[0, 15] = False
    errors = errors_of(ConstantVelocity(), shards(tmp_path, [sample]))
    assert errors.distance.shape == (2, 16)  # the ego and the other actor


def test_every_episode_counts_once_however_long(tmp_path):
    now = sampled(scene([Body(10.0, 0.0, speed=5.0)]))
    errors = errors_of(ConstantVelocity(), shards(tmp_path, [now] * 9, [off_by(now, 1.0)]))
    means = report({"a": errors})["means"]["a"]
    assert means["neighbours: FDE at 8 s"]["mean"] == pytest.approx(4.0, abs=1e-4)
    assert means["neighbours: FDE at 8 s"]["n"] == 2


def test_what_vehicles_did_is_told_apart(tmp_path):
    stands, drives = Body(10.0, 0.0), Body(20.0, 0.0, speed=5.0)
    sample = sampled(scene([stands, drives]))
    started = off_by(sample, 1.0)  # the standing one drives off
    cases = miss_cases(errors_of(ConstantVelocity(), shards(tmp_path, [sample], [started])))
    assert cases["stays where it stands"] == (1, 0.0)
    assert cases["drives off"] == (1, 100.0)
    assert cases["drives on"] == (2, 50.0)
    assert cases["turns"] == (0, 0.0)


def test_the_command_compares_all_predictors(tmp_path, monkeypatch, capsys):
    shards(tmp_path, *[[sampled(busy(seed))] for seed in range(3)])
    out = tmp_path / "results.json"
    monkeypatch.setattr(sys, "argv", ["evaluate", "--data", str(tmp_path), "--out", str(out)])
    evaluate.main()
    document = json.loads(out.read_text())
    assert set(document["means"]) == {"constant velocity", "CTRA", "IDM", "learned"}
    assert document["means"]["constant velocity"]["neighbours: FDE at 8 s"]["mean"] == pytest.approx(0.0, abs=1e-3)
    assert document["learned against"]["constant velocity"]["neighbours: FDE at 8 s"]["difference"]["mean"] > 0.0
    assert capsys.readouterr().out.splitlines() == table(document)
