"""An ONNX policy to submit: `python examples/onnx_policy.py policy.onnx`. Pure pursuit that slows for others ahead."""

import sys

import torch

SENSORS = ("route", "objects", "junctions_ahead")  # track "privileged", control "target_speed_steering"
SHAPES = ((80, 7), (48, 8), (4, 4))


class Pursuit(torch.nn.Module):
    """Steers to a point of the route, and drives only as fast as the free distance ahead allows."""

    def forward(self, route, objects, junctions):
        """One decision: target speed [m/s] and steering [-1, 1], from arrays in metres of the ego's frame."""
        path = route[:40, :2]
        gaps = (path[:, None] - objects[None, :, 1:3]).square().sum(2).sqrt() + 1000.0 * (objects[:, 0] < 0)
        blocked = gaps.min(1).values < 2.0
        free = torch.where(blocked, torch.arange(40.0), 45.0).min() - 5.0
        red = (junctions[0, 2] == 1) & (junctions[0, 0] > 0)  # at least one metre before its line
        free = torch.where(red, torch.minimum(free, junctions[0, 0] - 1.0), free)
        speed = torch.minimum(route[0, 4], 0.6 * free.clamp(min=0.0))
        x, y = route[6, 0], route[6, 1]
        steering = torch.atan(2 * 2.7 * y / (x * x + y * y)) / 0.6  # wheelbase [m], angle at full lock [rad]
        return torch.stack([speed, steering])


def export(path: str) -> None:
    """Writes the policy; the names are the published ones."""
    example = tuple(torch.zeros(shape) for shape in SHAPES)
    torch.onnx.export(Pursuit(), example, path, input_names=list(SENSORS), output_names=["action"], dynamo=False)


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    export(sys.argv[1])
