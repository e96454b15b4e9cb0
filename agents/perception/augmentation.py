"""Augmentations of a batch of pictures, each picture with its own draw.

    generator = torch.Generator().manual_seed(seed)      # its state is part of a checkpoint
    pictures = random_shift(pictures, generator, pad=4)

Pictures are (B, C, H, W) in uint8, or in float within [0, 1], and come back in the same type. A stack of RGB frames in
the channels is one picture: its frames are changed alike. Draws are made on the generator's device, so that one seed
gives the same draws wherever the pictures are.

Source: DrQ's shift (Kostrikov et al. 2021), CURL's crop (Laskin et al. 2020); jitter, blur and erasing are defined as
torchvision's ColorJitter, GaussianBlur and RandomErasing, which draw once per batch where these draw per picture.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
from tensordict import TensorDictBase
from torch import Generator, Tensor
from torch.nn.functional import pad as padded

from dohyo.sumo_networks.errors import InvalidInputError

Augmentation = Callable[[Tensor, Generator], Tensor]
"""What `functools.partial` makes of a function here and its settings."""
Range = tuple[float, float]

GREY = (0.299, 0.587, 0.114)
"""Weights of red, green and blue (ITU-R BT.601)."""
ERASING_ATTEMPTS = 10
BLOCK = 16
"""Pictures that a processor changes at once: the numbers of more leave its cache, which takes five times as long."""


def random_shift(pictures: Tensor, generator: Generator, *, pad: int) -> Tensor:
    """Shifts by up to `pad` whole pixels per axis, with the border's values beyond the border.

    DrQ-v2 interpolates between pixels; at whole pixels that changes nothing.
    """
    height, width = pictures.shape[2:]
    return random_crop(padded(pictures, (pad,) * 4, "replicate"), generator, height=height, width=width)


def random_crop(pictures: Tensor, generator: Generator, *, height: int, width: int) -> Tensor:
    """Crops to (B, C, height, width), at a place drawn uniformly.

    Raises:
        InvalidInputError: The pictures are smaller than the crop.
    """
    down, right = _room(pictures, height, width)
    tops, lefts = (_integers(generator, len(pictures), most).to(pictures.device) for most in (down, right))
    places = zip(pictures, tops.tolist(), lefts.tolist(), strict=True)
    return torch.stack([one[:, top : top + height, left : left + width] for one, top, left in places])


def centre_crop(pictures: Tensor, *, height: int, width: int) -> Tensor:
    """Crops the middle, as an evaluation does where a training crops at random.

    Raises:
        InvalidInputError: The pictures are smaller than the crop.
    """
    down, right = _room(pictures, height, width)
    return pictures[:, :, down // 2 : down // 2 + height, right // 2 : right // 2 + width]


def colour_jitter(
    pictures: Tensor,
    generator: Generator,
    *,
    brightness: float = 0.0,
    contrast: float = 0.0,
    saturation: float = 0.0,
    hue: float = 0.0,
) -> Tensor:
    """Changes colours by factors in [1 - x, 1 + x], and the hue by a share of its circle in [-x, x].

    The order of the four changes is drawn once per batch.

    Args:
        pictures: RGB, or a stack of RGB frames.
        generator: Of the draws.
        brightness: Of a factor on each value.
        contrast: Of a factor on the difference from the mean grey of a frame.
        saturation: Of a factor on the difference from a pixel's own grey.
        hue: At most 0.5.

    Raises:
        InvalidInputError: The channels are no RGB frames.
    """
    if pictures.shape[1] % 3:
        raise InvalidInputError(f"expected RGB pictures or stacks of them, got {pictures.shape[1]} channels")
    factors = [
        _uniform(generator, len(pictures), (max(1.0 - x, 0.0), 1.0 + x)) for x in (brightness, contrast, saturation)
    ]
    factors.append(_uniform(generator, len(pictures), (-hue, hue)))
    drawn = torch.randperm(4, generator=generator, device=generator.device).tolist()
    order = [number for number in drawn if (brightness, contrast, saturation, hue)[number]]

    def changed(values: Tensor, rows: slice) -> Tensor:
        frames = values.reshape(len(values), -1, 3, *values.shape[2:])
        for number in order:
            factor = factors[number][rows].to(values.device).reshape(-1, 1, 1, 1, 1)
            frames = _JITTERS[number](frames, factor)
        return frames.flatten(1, 2)

    return _in_float(pictures, changed)


def gaussian_blur(pictures: Tensor, generator: Generator, *, kernel: int = 3, sigma: Range = (0.1, 2.0)) -> Tensor:
    """Blurs by a Gaussian whose standard deviation is drawn, with the picture mirrored beyond its border.

    Args:
        pictures: Any channels.
        generator: Of the draws.
        kernel: Its side, odd, pixels.
        sigma: Smallest and largest standard deviation, pixels.

    Raises:
        InvalidInputError: The kernel's side is even.
    """
    if kernel % 2 == 0:
        raise InvalidInputError(f"expected a kernel with an odd side, got {kernel}")
    deviation = _uniform(generator, len(pictures), sigma).to(pictures.device)
    offsets = torch.arange(kernel, device=pictures.device) - kernel // 2
    weights = torch.exp(-0.5 * (offsets / deviation[:, None]).square())
    weights = weights / weights.sum(1, keepdim=True)

    def blurred(values: Tensor, rows: slice) -> Tensor:
        taps = weights[rows].to(values.dtype)[..., None, None, None]
        for axis, margin in ((3, (kernel // 2, kernel // 2, 0, 0)), (2, (0, 0, kernel // 2, kernel // 2))):
            around, side = padded(values, margin, "reflect"), values.shape[axis]
            values = torch.zeros_like(values)
            for k in range(kernel):
                values.addcmul_(around.narrow(axis, k, side), taps[:, k])
        return values

    return _in_float(pictures, blurred)


def random_erasing(
    pictures: Tensor,
    generator: Generator,
    *,
    probability: float = 0.25,
    share: Range = (0.02, 0.05),
    ratio: Range = (0.1, 2.1),
) -> Tensor:
    """Sets a rectangle of some pictures to 0.

    Args:
        pictures: Any channels.
        generator: Of the draws.
        probability: Share of pictures that lose a rectangle.
        share: Smallest and largest area, of the picture's.
        ratio: Smallest and largest height over width; drawn uniformly in its logarithm.
    """
    count, (height, width) = len(pictures), pictures.shape[2:]
    drawn = torch.rand(count, ERASING_ATTEMPTS, 4, generator=generator, device=generator.device)
    erased = torch.rand(count, generator=generator, device=generator.device) < probability
    area = height * width * (share[0] + drawn[..., 0] * (share[1] - share[0]))
    low, high = torch.tensor(ratio, device=generator.device).log()
    tall = torch.exp(low + drawn[..., 1] * (high - low))
    heights, widths = (area * tall).sqrt().round(), (area / tall).sqrt().round()
    fits = (heights < height) & (widths < width)
    first = fits.int().argmax(1, keepdim=True)
    tops, lefts = drawn[..., 2] * (height - heights + 1), drawn[..., 3] * (width - widths + 1)
    box = [side.gather(1, first).floor().to(pictures.device) for side in (tops, heights, lefts, widths)]
    rows = _within(torch.arange(height, device=pictures.device), box[0], box[1])
    columns = _within(torch.arange(width, device=pictures.device), box[2], box[3])
    chosen = (erased & fits.any(1)).to(pictures.device)[:, None, None]
    return pictures.masked_fill((rows[:, :, None] & columns[:, None, :] & chosen)[:, None], 0)


def of_transitions(
    augmentation: Augmentation, names: Sequence[str], generator: Generator = torch.default_generator
) -> Callable[[TensorDictBase], TensorDictBase]:
    """An augmentation of the pictures before and after each transition of a batch, with draws of their own.

    Args:
        augmentation: Such as `partial(random_shift, pad=4)`.
        names: Of the observations that are pictures.
        generator: Of the draws; torch's own is stored by a run's checkpoints.
    """

    def augmented(batch: TensorDictBase) -> TensorDictBase:
        keys = [(*moment, "observation", name) for moment in ((), ("next",)) for name in names]
        changed = batch.copy()
        for key in keys:
            changed[key] = augmentation(batch[key], generator)
        return changed

    return augmented


def _brighter(frames: Tensor, factor: Tensor) -> Tensor:
    return frames.mul_(factor).clamp_(0.0, 1.0)


def _more_contrast(frames: Tensor, factor: Tensor) -> Tensor:
    return _from(_grey(frames.mean((-2, -1), keepdim=True)), frames, factor)


def _more_saturated(frames: Tensor, factor: Tensor) -> Tensor:
    return _from(_grey(frames), frames, factor)


def _from(centre: Tensor, frames: Tensor, factor: Tensor) -> Tensor:
    """Frames whose distance from a centre is multiplied."""
    return frames.mul_(factor).add_(centre * (1.0 - factor)).clamp_(0.0, 1.0)


def _turned_hue(frames: Tensor, turn: Tensor) -> Tensor:
    """RGB to hue, saturation and value, and back."""
    red, green, blue = frames.unbind(-3)
    value, spread = frames.amax(-3), frames.amax(-3) - frames.amin(-3)
    divisor = torch.where(spread > 0, spread, 1.0)
    sector = torch.where(
        value == red,
        (green - blue) / divisor,
        torch.where(value == green, 2.0 + (blue - red) / divisor, 4.0 + (red - green) / divisor),
    )
    sector = sector + 6.0 * turn.squeeze(-3)
    places = [torch.remainder(sector + offset, 6.0) for offset in (5.0, 3.0, 1.0)]
    return torch.stack([value - spread * torch.minimum(p, 4.0 - p).clamp(0.0, 1.0) for p in places], dim=-3)


_JITTERS = (_brighter, _more_contrast, _more_saturated, _turned_hue)


def _grey(frames: Tensor) -> Tensor:
    """(..., 1, H, W) brightness of RGB frames (..., 3, H, W)."""
    red, green, blue = frames.unbind(-3)
    return (red * GREY[0]).add_(green, alpha=GREY[1]).add_(blue, alpha=GREY[2]).unsqueeze(-3)


def _in_float(pictures: Tensor, change: Callable[[Tensor, slice], Tensor]) -> Tensor:
    """A change of values in [0, 1], for pictures of either type.

    Args:
        pictures: (B, C, H, W).
        change: Of the values of some rows, which it may overwrite.
    """
    out = torch.empty_like(pictures)
    size = BLOCK if pictures.device.type == "cpu" else max(len(pictures), 1)
    for start in range(0, len(pictures), size):
        rows = slice(start, start + size)
        if pictures.dtype == torch.uint8:
            out[rows] = change(pictures[rows].float().div_(255.0), rows).mul_(255.0).round_()
        else:
            out[rows] = change(pictures[rows].clone(), rows)
    return out


def _room(pictures: Tensor, height: int, width: int) -> tuple[int, int]:
    """Pixels that a crop leaves over, per axis."""
    if pictures.shape[2] < height or pictures.shape[3] < width:
        raise InvalidInputError(f"expected pictures of at least {height} x {width}, got {tuple(pictures.shape)}")
    return pictures.shape[2] - height, pictures.shape[3] - width


def _integers(generator: Generator, count: int, most: int) -> Tensor:
    return torch.randint(0, most + 1, (count,), generator=generator, device=generator.device)


def _uniform(generator: Generator, count: int, bounds: Range) -> Tensor:
    low, high = bounds
    return low + (high - low) * torch.rand(count, generator=generator, device=generator.device)


def _within(places: Tensor, start: Tensor, length: Tensor) -> Tensor:
    """(B, N) whether each of (N,) places is in the interval of each picture, (B, 1)."""
    return (places >= start) & (places < start + length)
