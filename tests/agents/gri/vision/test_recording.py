"""Recording for A-VIS: what is drawn for each split, and what a drive holds."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from dohyo.agents.gri.vision import recording
from dohyo.agents.gri.vision.cameras import OFF
from dohyo.agents.gri.vision.moments import Moments
from dohyo.agents.gri.vision.recording import COLUMNS, JUDGED, SPLITS, AffordanceRequest, record_affordances, recorded
from dohyo.agents.perception.drives import digest_of
from dohyo.sumo_networks.conditions import TEST, TRAIN
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.seeds import HELD_OUT_FROM
from tests.agents.gri.vision.data import moments

SHORT = AffordanceRequest(moments=1, egos=2, every_s=2.0, episode_s=12.0)


def test_it_learns_from_the_town_and_conditions_of_training_and_is_judged_on_held_out_seeds():
    order = AffordanceRequest(moments=4000)
    scenarios = {split: [one for name, one in order.episodes() if name == split] for split in SPLITS}
    for split in ("train", "validation"):
        assert {one.network for one in scenarios[split]} == {"town-train"}
        assert {one.conditions for one in scenarios[split]} <= set(TRAIN)
        assert all(one.seed < HELD_OUT_FROM for one in scenarios[split])
    assert {one.conditions for one in scenarios["train"]} == set(TRAIN)
    for split in JUDGED:
        assert all(one.seed >= HELD_OUT_FROM for one in scenarios[split])
        assert {one.network for one in scenarios[split]} == {split.removesuffix("-test-conditions")}
        assert {one.conditions for one in scenarios[split]} <= set(TEST if "test-conditions" in split else TRAIN)
    names = [one.name for split in SPLITS for one in scenarios[split]]
    assert len(set(names)) == len(names)
    assert len(scenarios["train"]) * 8 * 40 >= 4000


@pytest.mark.slow
def test_a_drive_has_pictures_labels_and_poses_and_comes_again():
    (scenario,) = [one for split, one in SHORT.episodes() if split == "train"]
    first, again = (recorded(scenario, SHORT) for _ in range(2))
    assert {ego: digest_of(arrays) for ego, (arrays, _) in first.items()} == {
        ego: digest_of(arrays) for ego, (arrays, _) in again.items()
    }
    arrays, facts = next(iter(first.values()))
    assert tuple(arrays) == COLUMNS
    assert (arrays["pictures"].shape, arrays["classes"].shape) == ((6, 3, 3, 64, 64), (6, 3, 64, 64))
    assert facts["conditions"] == scenario.conditions
    poses = np.concatenate([arrays["displacement"] for arrays, _ in first.values()])
    assert (np.abs(poses) <= np.array(list(OFF.values())) + 1e-6).all()
    assert len(np.unique(arrays["displacement"], axis=0)) <= 3, "a pose is kept for five seconds"
    assert poses.any(), "and drawn"


def test_a_data_set_resumes_grows_and_refuses_another_order(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    driven = []

    def made_up(scenario, order):
        driven.append(scenario.name)
        return {"ego": (moments(3, scenario.seed % 97), {"seed": scenario.seed})}

    monkeypatch.setattr(recording, "recorded", made_up)
    assert record_affordances(AffordanceRequest(moments=1), tmp_path) == 3 * len(SPLITS)
    assert json.loads((tmp_path / "dataset.json").read_text())["seed"] == 0
    assert len(Moments.load(tmp_path, "town-test")) == 3
    driven.clear()
    assert record_affordances(AffordanceRequest(moments=321), tmp_path) == 3 * (len(SPLITS) + 1)
    assert driven == ["affordances-town-train-1"], "those that are there stay"
    with pytest.raises(InvalidInputError, match="expected a dataset made with"):
        record_affordances(AffordanceRequest(moments=1, seed=1), tmp_path)
