"""Convolutions: sizes of their outputs, without torch."""

from __future__ import annotations

from dataclasses import dataclass

from dohyo.sumo_networks.errors import InvalidInputError


def convolved(side: int, kernel: int, stride: int) -> int:
    """Side of the output of a convolution without padding, in pixels.

    Raises:
        InvalidInputError: The input is smaller than the kernel.
    """
    if side < kernel:
        raise InvalidInputError(f"expected pictures of at least {kernel} pixels before a convolution, got {side}")
    return (side - kernel) // stride + 1


@dataclass(frozen=True, slots=True)
class Convolutions:
    """Pictures, and the stack of convolutions without padding that reads them.

    Attributes:
        channels: Of a picture.
        height: Of a picture.
        width: Of a picture.
        filters: Output channels of each convolution.
        kernel: Side of each kernel.
        stride: Of each convolution.
    """

    channels: int
    height: int
    width: int
    filters: tuple[int, ...] = (32, 64, 128, 256)
    kernel: int = 4
    stride: int = 2

    @property
    def sizes(self) -> list[tuple[int, int]]:
        """Height and width of a picture, and after each convolution."""
        out = [(self.height, self.width)]
        for _ in self.filters:
            height, width = (convolved(side, self.kernel, self.stride) for side in out[-1])
            out.append((height, width))
        return out

    @property
    def outputs(self) -> int:
        """Number of outputs of the last convolution."""
        height, width = self.sizes[-1]
        return self.filters[-1] * height * width
