"""Augmentations: each against its definition, picture by picture."""

from __future__ import annotations

import colorsys
from functools import partial

import cv2
import numpy as np
import pytest
import torch
from tensordict import TensorDict
from torch import Generator, Tensor

from dohyo.agents.perception.augmentation import (
    centre_crop,
    colour_jitter,
    gaussian_blur,
    of_transitions,
    random_crop,
    random_erasing,
    random_shift,
)
from dohyo.sumo_networks.errors import InvalidInputError

ALL = {
    "shift": partial(random_shift, pad=4),
    "crop": partial(random_crop, height=20, width=24),
    "jitter": partial(colour_jitter, brightness=0.3, contrast=0.3, saturation=0.3, hue=0.05),
    "blur": gaussian_blur,
    "erasing": partial(random_erasing, probability=0.9),
}


def pictures(count: int = 6, channels: int = 3, height: int = 28, width: int = 32, seed: int = 0) -> Tensor:
    return torch.randint(1, 256, (count, channels, height, width), dtype=torch.uint8, generator=seeded(seed))


def seeded(seed: int = 0) -> Generator:
    return Generator().manual_seed(seed)


@pytest.mark.parametrize("name", ALL)
def test_the_generator_alone_decides(name):
    change, batch = ALL[name], pictures()
    torch.manual_seed(1)
    first = change(batch, seeded())
    torch.manual_seed(2)
    assert torch.equal(change(batch, seeded()), first)
    generator = seeded()
    change(batch, generator)
    state = generator.get_state()
    second = change(batch, generator)
    assert not torch.equal(second, first)
    resumed = Generator()
    resumed.set_state(state)
    assert torch.equal(change(batch, resumed), second)


@pytest.mark.parametrize("name", ALL)
def test_bytes_and_floats_are_changed_alike_and_nothing_in_place(name):
    batch = pictures(channels=6)
    before = batch.clone()
    as_bytes, as_floats = ALL[name](batch, seeded()), ALL[name](batch.float() / 255.0, seeded())
    assert (as_bytes.dtype, as_floats.dtype) == (torch.uint8, torch.float32)
    assert as_bytes.shape == as_floats.shape
    assert 0.0 <= as_floats.min() <= as_floats.max() <= 1.0
    assert (as_bytes.float() / 255.0 - as_floats).abs().max() <= 0.5 / 255.0 + 1e-6
    assert torch.equal(batch, before)


@pytest.mark.parametrize("name", ALL)
def test_every_picture_has_its_own_draw_and_the_frames_of_one_share_it(name):
    frame = pictures(1).repeat(12, 1, 1, 1)
    out = ALL[name](torch.cat([frame, frame], dim=1), seeded())
    assert torch.equal(out[:, :3], out[:, 3:])
    assert len({picture.numpy().tobytes() for picture in out}) > 6


@pytest.mark.parametrize("pad", [1, 4])
def test_shifts_are_crops_of_the_padded_picture(pad):
    batch = pictures(count=40)
    out = random_shift(batch, seeded(), pad=pad).numpy()
    draws = seeded()
    places = torch.stack([torch.randint(0, 2 * pad + 1, (40,), generator=draws) for _ in "yx"], dim=1).tolist()
    for number, (top, left) in enumerate(places):
        padded = np.pad(batch[number].numpy(), ((0, 0), (pad, pad), (pad, pad)), mode="edge")
        np.testing.assert_array_equal(out[number], padded[:, top : top + 28, left : left + 32])


def test_crops_are_windows_and_reach_every_place():
    batch = pictures(count=200, height=6, width=7)
    out = random_crop(batch, seeded(), height=5, width=5)
    found = set()
    for before, after in zip(batch, out, strict=True):
        places = [(y, x) for y in range(2) for x in range(3) if torch.equal(before[:, y : y + 5, x : x + 5], after)]
        found.update(places)
        assert len(places) == 1
    assert len(found) == 6
    assert torch.equal(centre_crop(batch, height=4, width=5), batch[:, :, 1:5, 1:6])
    with pytest.raises(InvalidInputError, match="at least 8 x 7"):
        random_crop(batch, seeded(), height=8, width=7)


@pytest.mark.parametrize("kernel", [3, 5, 7])
def test_blur_is_that_of_opencv(kernel):
    batch = pictures().float() / 255.0
    out = gaussian_blur(batch, seeded(3), kernel=kernel, sigma=(0.4, 2.0))
    sigmas = 0.4 + 1.6 * torch.rand(len(batch), generator=seeded(3))
    for picture, blurred, sigma in zip(batch, out, sigmas.tolist(), strict=True):
        expected = cv2.GaussianBlur(
            picture.permute(1, 2, 0).numpy(), (kernel, kernel), sigma, borderType=cv2.BORDER_REFLECT_101
        )
        np.testing.assert_allclose(blurred.permute(1, 2, 0).numpy(), expected, atol=1e-5)


def test_an_even_kernel_is_refused():
    with pytest.raises(InvalidInputError, match="odd side, got 4"):
        gaussian_blur(pictures(), seeded(), kernel=4)


def jittered(picture: np.ndarray, factors: list[float], order: list[int]) -> np.ndarray:
    """(H, W, 3) by the definition: one change after the other, hue by colorsys."""
    for number in order:
        grey = cv2.cvtColor(picture.astype(np.float32), cv2.COLOR_RGB2GRAY)[:, :, None]
        if number == 0:
            picture = picture * factors[0]
        elif number == 1:
            picture = factors[1] * picture + (1 - factors[1]) * grey.mean()
        elif number == 2:
            picture = factors[2] * picture + (1 - factors[2]) * grey
        else:
            turned = [colorsys.rgb_to_hsv(*pixel) for pixel in picture.reshape(-1, 3)]
            back = [colorsys.hsv_to_rgb((h + factors[3]) % 1.0, s, v) for h, s, v in turned]
            picture = np.array(back).reshape(picture.shape)
        picture = picture.clip(0.0, 1.0)
    return picture


@pytest.mark.parametrize("seed", range(4))
def test_jitter_is_its_definition(seed):
    batch = pictures(count=3, height=8, width=9, seed=seed).float() / 255.0
    batch[0, :, :2] = 0.5  # grey has no hue
    out = colour_jitter(batch, seeded(seed), brightness=0.5, contrast=0.5, saturation=0.5, hue=0.3)
    draws = seeded(seed)
    factors = [0.5 + torch.rand(3, generator=draws) for _ in range(3)] + [-0.3 + 0.6 * torch.rand(3, generator=draws)]
    order = torch.randperm(4, generator=draws).tolist()
    for number in range(3):
        expected = jittered(batch[number].permute(1, 2, 0).numpy(), [f[number].item() for f in factors], order)
        np.testing.assert_allclose(out[number].permute(1, 2, 0).numpy(), expected, atol=2e-5)


def test_jitter_of_nothing_changes_nothing_and_needs_rgb():
    batch = pictures()
    assert torch.equal(colour_jitter(batch, seeded()), batch)
    with pytest.raises(InvalidInputError, match="got 4 channels"):
        colour_jitter(pictures(channels=4), seeded(), brightness=0.1)


def test_erasing_sets_one_rectangle_of_the_right_size_to_nothing():
    batch = pictures(count=400, height=40, width=60)
    out = random_erasing(batch, seeded(), probability=0.5, share=(0.02, 0.1), ratio=(0.5, 2.0))
    erased = (out == 0).all(1)
    count = 0
    for number in range(len(batch)):
        places = erased[number].nonzero()
        assert torch.equal(out[number][:, ~erased[number]], batch[number][:, ~erased[number]])
        if not len(places):
            continue
        count += 1
        height, width = (places.amax(0) - places.amin(0) + 1).tolist()
        assert height * width == len(places), "a rectangle"
        assert 0.015 < height * width / 2400 < 0.11
        assert 0.4 < height / width < 2.5
    assert 160 < count < 240
    assert torch.equal(random_erasing(batch, seeded(), probability=0.0), batch)


def test_a_rectangle_that_never_fits_erases_nothing():
    batch = pictures(height=4, width=200)
    assert torch.equal(random_erasing(batch, seeded(), probability=1.0, share=(0.9, 0.95), ratio=(8.0, 9.0)), batch)


def test_transitions_are_augmented_before_and_after():
    shown, after, vector = pictures(seed=1), pictures(seed=2), torch.rand(6, 2)
    batch = TensorDict({"observation": {"camera": shown, "speed": vector}}, [6])
    batch["next"] = TensorDict({"observation": {"camera": after, "speed": vector}}, [6])
    shift = partial(random_shift, pad=4)
    out = of_transitions(shift, ["camera"], seeded())(batch)
    draws = seeded()
    assert torch.equal(out["observation", "camera"], shift(shown, draws))
    assert torch.equal(out["next", "observation", "camera"], shift(after, draws))
    assert torch.equal(out["observation", "speed"], vector)
    assert torch.equal(batch["observation", "camera"], shown)
    torch.manual_seed(5)
    of_torch = of_transitions(shift, ["camera"])(batch)
    torch.manual_seed(5)
    assert torch.equal(
        of_transitions(shift, ["camera"])(batch)["observation", "camera"], of_torch["observation", "camera"]
    )
