"""RLfOLD: two deviations, labels in the replay, an imitation that moves actor and encoder, and the gate."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.stats import truncnorm
from tensordict import TensorDict

from dohyo.agents.endless_driving.config import TownConfig
from dohyo.agents.endless_driving.latent import Latent, LatentConfig
from dohyo.agents.endless_driving.task import EndlessDriving
from dohyo.agents.learning.experience.behaviour import DEMONSTRATOR, POLICY
from dohyo.agents.perception.encoders.rlad import RladEncoder
from dohyo.agents.perception.encoders.waypoints import WayConv1D
from dohyo.agents.rlfold.rlfold import DEVIATION, Rlfold, RlfoldConfig
from dohyo.agents.rlfold.training import TOWN, RlfoldRunConfig, augmentation
from dohyo.agents.rlfold.two_deviations import TwoDeviationsHead, truncated_log_density
from tests.agents.learning.killed import killed_and_resumed
from tests.agents.learning.learners import learner, transitions

TASK = EndlessDriving(TownConfig(roads="one-route", view="state", history=1))
SMALL = RlfoldConfig(hidden=(16,), batch=32)


def made(folder: Path, **changes: object) -> Rlfold:
    config = SMALL.model_copy(update=changes)
    one: Rlfold = learner(Rlfold, config, TASK, folder, encoder=Latent(TASK.observation_space, LatentConfig()))
    return one


def batch(count: int = 32) -> TensorDict:
    found = transitions(TASK, count)
    found["label"] = torch.full((count, 2), 0.5)
    found["labelled"] = torch.arange(count) % 2 == 0
    return found


@pytest.mark.parametrize("bounded", [False, True])
def test_what_explores_imitates_and_drives_has_one_mean(bounded: bool) -> None:
    torch.manual_seed(0)
    head = TwoDeviationsHead(3, 2, (8,), bounded)
    features = 50.0 * torch.randn(40, 3)
    exploring, log_std = head(features)
    imitating, _ = head.imitating(features)
    assert torch.equal(head.centre(features), imitating), "it drives by what it imitates with"
    assert torch.equal(exploring if bounded else exploring.tanh(), imitating)
    assert (exploring.abs().max() <= 1.0).item() is bounded
    assert log_std.shape == exploring.shape


def test_its_density_is_that_of_a_truncated_gaussian() -> None:
    values = np.linspace(-1.0, 1.0, 41)
    for mean, std in ((0.0, 0.1), (0.95, 0.1), (-0.3, 1.5)):
        expected = truncnorm.logpdf(values, (-1.0 - mean) / std, (1.0 - mean) / std, mean, std)
        found = truncated_log_density(torch.tensor(values), torch.tensor(mean), torch.tensor(std))
        np.testing.assert_allclose(found.numpy(), expected, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("imitation", ["likelihood", "squared"])
def test_the_imitation_moves_actor_and_encoder_towards_the_experts_speed_alone(tmp_path: Path, imitation: str) -> None:
    rlfold, seen = made(tmp_path, imitation=imitation), batch()
    (loss,) = rlfold._auxiliary

    def distances() -> list[float]:
        with torch.no_grad():
            mean, _ = rlfold.actor.imitating(rlfold.encoder(seen["observation"]))
        return (mean - seen["label"]).abs().mean(dim=0).tolist()

    before = distances()
    loss(seen, rlfold.encoder(seen["observation"])).backward()
    moved = [parameter.grad for parameter in rlfold.encoder.parameters()]
    assert all(gradient is not None and gradient.abs().sum() > 0.0 for gradient in moved)
    last = rlfold.actor.body[-1]
    assert last.weight.grad[0].abs().sum() > 0.0  # the mean of the speed
    assert last.weight.grad[1].abs().sum() == 0.0  # that of the steering
    assert last.weight.grad[2:4].abs().sum() == 0.0  # sigma_RL of both
    with torch.no_grad():
        for parameter in (*rlfold.encoder.parameters(), *rlfold.actor.parameters()):
            parameter -= 0.03 * parameter.grad
    assert distances()[0] < before[0]


def test_a_training_reads_waypoints_by_a_convolution_and_two_pictures_by_a_lix() -> None:
    """Coelho 2024, section 4.3.2."""
    settings = RlfoldRunConfig()
    latent = Latent(settings.task.observation_space, settings.latent)
    assert any(isinstance(layer, WayConv1D) for layer in latent.ahead.modules())
    assert isinstance(latent.seen, RladEncoder)
    assert latent.seen.shape[0] == 2 * 3
    assert latent.seen.mixing is not None


@pytest.mark.parametrize(("side", "most"), [(64, 2), (256, 8)])
def test_pictures_are_shifted_by_as_much_of_their_side_as_in_the_thesis(side: int, most: int) -> None:
    torch.manual_seed(0)
    augment = augmentation(RlfoldRunConfig(town=TOWN.model_copy(update={"side": side})))
    assert augment is not None
    pictures = torch.zeros(128, 6, 24, side, dtype=torch.uint8)
    pictures[..., side // 2] = 255
    one = TensorDict({"observation": {"camera": pictures}, "next": {"observation": {"camera": pictures}}}, [128])
    columns = augment(one)["observation", "camera"].float().mean(dim=(1, 2)).argmax(dim=1)
    assert int((columns - side // 2).abs().max()) == most


def test_only_transitions_with_a_label_are_imitated(tmp_path: Path) -> None:
    rlfold, seen = made(tmp_path), batch()
    (loss,) = rlfold._auxiliary
    features = rlfold.encoder(seen["observation"]).detach()
    before = loss(seen, features)
    seen["label"][1::2] = -1.0  # those without one
    assert loss(seen, features) == before
    seen["label"][::2] = -1.0
    assert loss(seen, features) != before


@pytest.mark.parametrize(("gate", "share"), [("uncertainty", 0.5), ("share", 0.3), ("never", 0.0)])
def test_the_expert_takes_the_speed_where_the_gate_opens(tmp_path: Path, gate: str, share: float) -> None:
    rlfold, count = made(tmp_path, gate=gate), 4000
    deviations = torch.linspace(0.6, 1.0, count)  # half of them above 0.8

    def policy(observation: TensorDict) -> TensorDict:
        return TensorDict({"action": torch.zeros(count, 2), DEVIATION: deviations}, [count])

    behaviour = rlfold._make_behaviour(policy)
    label, known = torch.full((count, 2), 0.7), torch.arange(count) % 10 != 0
    chosen = behaviour.act(TensorDict({}, [count]), label, known)
    taken = chosen["action"][:, 0] == label[:, 0]
    assert float(taken.float().mean()) == pytest.approx(0.9 * share, abs=0.04)
    assert not taken[~known].any()
    assert (chosen["action"][:, 1] == 0.0).all()  # the steering is the policy's
    assert torch.equal(chosen["source"] == DEMONSTRATOR, taken)
    assert torch.equal(chosen["source"] == POLICY, ~taken)
    if gate == "uncertainty":
        assert torch.equal(taken, (deviations > 0.8) & known)


def test_a_killed_run_ends_bit_equal_to_one_that_was_not_and_keeps_its_labels(tmp_path: Path) -> None:
    whole = killed_and_resumed("tests.agents.rlfold.plane:PLANE", [], tmp_path)
    entries = TensorDict.load_memmap(whole / "replay")
    acted = (entries["after"] > 0).nonzero().flatten()
    assert len(acted) == 600
    assert entries["labelled"][acted].all()
    expected = (-5.0 * entries["observation.observation"][acted]).clamp(-1.0, 1.0)
    assert torch.allclose(entries["label"][acted], expected)  # of the place where the step began
