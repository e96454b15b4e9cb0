"""A-LIX: the shift against grid sampling, the measure of gradients against slow loops, and the tuned strength."""

from __future__ import annotations

import math

import pytest
import torch
from torch.nn.functional import grid_sample, pad

from dohyo.agents.perception.encoders.local_mixing import (
    TARGET,
    LocalMixing,
    discontinuity,
    parameter_groups,
    shift_maps,
)
from dohyo.agents.perception.encoders.rlad import RladEncoder


@pytest.mark.parametrize(("down", "right"), [(0.0, 0.0), (1.3, -0.7), (-2.5, 2.5), (0.25, 2.0), (-1.0, -0.01)])
def test_a_shift_is_bilinear_sampling(down, right):
    maps, margin = torch.randn(2, 3, 9, 9), 4
    rows, columns = (torch.arange(9) + shift + margin for shift in (down, right))
    places = torch.stack(torch.meshgrid(rows, columns, indexing="ij")[::-1], dim=-1)
    places = (places + 0.5) * 2 / (9 + 2 * margin) - 1
    expected = grid_sample(pad(maps, (margin,) * 4, "replicate"), places.expand(2, -1, -1, -1), align_corners=False)
    torch.testing.assert_close(shift_maps(maps, down, right), expected, atol=1e-5, rtol=1e-4)


def test_a_shift_of_whole_pixels_moves_them():
    maps = torch.arange(20.0).reshape(1, 1, 4, 5)
    torch.testing.assert_close(shift_maps(maps, 1.0, 0.0)[0, 0], maps[0, 0][[1, 2, 3, 3]])
    torch.testing.assert_close(shift_maps(maps, 0.0, -2.0)[0, 0], maps[0, 0][:, [0, 0, 0, 1, 2]])


def test_discontinuity_against_loops():
    gradient = torch.randn(3, 2, 4, 5)
    mean, total = gradient.mean(0), 0.0
    for c in range(2):
        for i in range(4):
            for j in range(5):
                around = [
                    mean[c, min(max(i + a, 0), 3), min(max(j + b, 0), 4)].item()
                    for a in (-1, 0, 1)
                    for b in (-1, 0, 1)
                    if (a, b) != (0, 0)
                ]
                centre = mean[c, i, j].item()
                noise = sum((value - centre) ** 2 for value in around) / 8
                energy = sum(value**2 for value in around) / 8
                total += math.log(1 + noise / energy)
    assert discontinuity(gradient).item() == pytest.approx(total / 40, rel=1e-4)


def test_discontinuity_is_nothing_where_gradients_agree_and_more_than_the_target_in_noise():
    assert discontinuity(torch.ones(2, 3, 8, 8)).item() == pytest.approx(0.0, abs=1e-6)
    assert discontinuity(torch.randn(1, 16, 32, 32)).item() > TARGET
    assert discontinuity(torch.zeros(1, 1, 4, 4)).item() == 0.0


def test_only_training_mixes():
    layer, maps = LocalMixing(), torch.randn(2, 3, 8, 8)
    assert not torch.equal(layer(maps), maps)
    layer.eval()
    assert layer(maps) is maps
    layer.train()
    with torch.no_grad():
        layer.strength.zero_()
    torch.testing.assert_close(layer(maps), maps)


def test_the_shift_is_within_the_strength_and_follows_from_the_seed():
    layer = LocalMixing(strength=0.4, reach=2.5)
    ramp = torch.arange(32.0).expand(1, 1, 32, 32)
    shifts = torch.stack([(layer(ramp) - ramp)[0, 0, 16, 16] for _ in range(300)])
    assert shifts.abs().max() <= 1.0 + 1e-4
    assert shifts.abs().max() > 0.95
    assert shifts.mean().abs() < 0.15
    torch.manual_seed(7)
    first = layer(ramp)
    torch.manual_seed(7)
    torch.testing.assert_close(layer(ramp), first)


@pytest.mark.parametrize(("side", "reached"), [(7, 0.5), (35, 2.5), (64, 2.5)])
def test_small_maps_are_shifted_by_the_same_share_of_their_side(side, reached):
    layer = LocalMixing(strength=1.0, side=35)
    ramp = torch.arange(float(side)).expand(1, 1, side, side)
    shifts = torch.stack([(layer(ramp) - ramp)[0, 0, side // 2, side // 2] for _ in range(300)])
    assert 0.95 * reached < shifts.abs().max() <= reached + 1e-4


@pytest.mark.parametrize(("gradient", "rises"), [("noise", True), ("constant", False)])
def test_the_strength_is_tuned_to_the_target(gradient, rises):
    layer = LocalMixing()
    optimiser = torch.optim.Adam(parameter_groups(layer)[1:])
    maps = torch.randn(4, 3, 8, 8, requires_grad=True)
    for _ in range(20):
        optimiser.zero_grad()
        out = layer(maps, tune=True)
        out.backward(torch.randn_like(out) if gradient == "noise" else torch.ones_like(out))
        optimiser.step()
    assert (layer.strength.item() > 0.5) == rises
    assert layer.strength.item() == pytest.approx(0.5, abs=0.06), "20 steps of at most 2e-3"


def test_the_gradient_of_maps_is_that_of_the_shift_alone():
    tuned, plain = LocalMixing(), LocalMixing()
    maps = torch.randn(2, 3, 6, 6)
    gradients = []
    for layer, tune in ((tuned, True), (plain, False)):
        torch.manual_seed(3)
        leaf = maps.clone().requires_grad_()
        layer(leaf, tune).square().sum().backward()
        gradients.append(leaf.grad)
    torch.testing.assert_close(*gradients)
    assert plain.strength.grad is None
    assert tuned.strength.grad is not None


def test_the_strength_stays_a_share():
    layer, maps = LocalMixing(), torch.randn(1, 1, 8, 8)
    for beyond, bound in ((1.7, 1.0), (-0.3, 0.0)):
        with torch.no_grad():
            layer.strength.fill_(beyond)
        layer(maps)
        assert layer.strength.item() == bound


def test_an_encoder_has_one_strength_with_its_own_learning_rate():
    encoder = RladEncoder((3, 64, 64))
    weights, strengths = parameter_groups(encoder)
    assert [s is encoder.mixing.strength for s in strengths["params"]] == [True]
    assert len(weights["params"]) == len(list(encoder.parameters())) - 1
    optimiser = torch.optim.Adam([weights, strengths], lr=1e-3)
    assert [(g["lr"], g["betas"]) for g in optimiser.param_groups] == [(1e-3, (0.9, 0.999)), (2e-3, (0.5, 0.999))]
    encoder(torch.rand(4, 3, 64, 64)).sum().backward()
    before = encoder.mixing.strength.item()
    optimiser.step()
    assert encoder.mixing.strength.item() != before
