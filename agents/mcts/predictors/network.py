"""The network: local encoders of histories and lanes, then attention with their relative poses.

Every polyline is encoded in a frame of its own (PointNet: a shared layer per point, then the maximum). Attention
between two of them gets their relative pose. Outputs are in the frame of their agent. So the futures do not depend on
the frame of the scene, nor on the order of rows.

Source: after Gao et al., VectorNet, 2020 (subgraphs of polylines, global attention), and Scheel et al., Urban Driver,
2021; relative poses after Cui et al., GoRela, 2022.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from dohyo.agents.mcts.predictors.described import (
    FAR_AGENT_M,
    FAR_LANE_M,
    NEAR_AGENT_M,
    NEAR_LANE_M,
    PAIR,
    PAST,
    PLAN,
    REACH_M,
    SEGMENT_SCALE,
    SHAPE,
    STEP_SCALE,
    TINY_M,
)
from dohyo.agents.planning.scene import HISTORY

STEPS, STEP_S = 16, 0.5
WIDTH, HEADS, LAYERS = 64, 4, 2
PAIR_WIDTH = 32
HIDDEN = -1e4


class MotionNetwork(nn.Module):
    """Sixteen poses, 0.5 s apart, for the ego and its neighbours."""

    def __init__(self, width: int = WIDTH, layers: int = LAYERS) -> None:
        super().__init__()
        self.of_history = PointNet(PAST, width)
        self.of_rolled, self.merge = PointNet(PLAN, width), nn.Linear(2 * width, width)
        self.of_lane = PointNet(SHAPE, width)
        self.to_agent, self.to_lane = _mlp(PAIR, PAIR_WIDTH), _mlp(PAIR, PAIR_WIDTH)
        self.layers = nn.ModuleList(RelativeAttention(width) for _ in range(layers))
        last = nn.Linear(2 * width, STEPS * 3)
        nn.init.normal_(last.weight, std=0.01)  # the untrained network returns the roll-out
        nn.init.zeros_(last.bias)
        self.head = nn.Sequential(nn.LayerNorm(width), nn.Linear(width, 2 * width), nn.ReLU(), last)
        self._which: Tensor
        self.register_buffer("_which", torch.eye(HISTORY), persistent=False)

    def forward(
        self,
        history: Tensor,
        history_valid: Tensor,
        agents: Tensor,
        agents_valid: Tensor,
        rolled: Tensor,
        points: Tensor,
        lanes: Tensor,
        lanes_valid: Tensor,
    ) -> Tensor:
        """Futures.

        Args:
            history: (B, A, 4, 3); see `features.SHAPES`.
            history_valid: (B, A, 4).
            agents: (B, A, 12).
            agents_valid: (B, A).
            rolled: (B, A, 16, 3) the IDM roll-out.
            points: (B, L, 20, 2), m.
            lanes: (B, L, 8).
            lanes_valid: (B, L).

        Returns:
            (B, A, 16, 3) x, y [m], heading [rad] in 0.5, 1.0, ..., 8 s, in the frame of the inputs. Rows of agents that
            are not valid mean nothing.
        """
        place, heading = history[:, :, -1, :2], history[:, :, -1, 2]
        ahead = torch.stack([torch.cos(heading), torch.sin(heading)], dim=-1)
        return self.futures(
            past=self._past(history, history_valid, agents, place, ahead),
            plan=_plan(rolled, place, heading, ahead),
            shape=_shape(points, lanes),
            between=_between_agents(place, ahead, agents[..., 0]),
            along=_along_lanes(place, ahead, points),
            rolled=rolled,
            agents_valid=agents_valid,
            lanes_valid=lanes_valid,
        )

    def futures(
        self,
        past: Tensor,
        plan: Tensor,
        shape: Tensor,
        between: Tensor,
        along: Tensor,
        rolled: Tensor,
        agents_valid: Tensor,
        lanes_valid: Tensor,
    ) -> Tensor:
        """Futures from what `described.SHAPES` lists, with a batch in front; see `forward`."""
        who = self.merge(torch.cat([self.of_history(past), self.of_rolled(plan)], dim=-1))
        where = self.of_lane(shape)
        pairs = torch.cat([self.to_agent(between), self.to_lane(along)], dim=2)
        mask = (1.0 - torch.cat([agents_valid, lanes_valid], dim=1))[:, None, :, None] * HIDDEN
        for layer in self.layers:
            who = layer(who, where, pairs, mask)
        return _corrected(rolled, self.head(who))

    def _past(self, history: Tensor, valid: Tensor, agents: Tensor, place: Tensor, ahead: Tensor) -> Tensor:
        """(B, A, 4, F) history in the agent's own frame, with its attributes."""
        moved = _turned(history[..., :2] - place[:, :, None], ahead[:, :, None]) / REACH_M
        turn = history[..., 2] - history[:, :, -1:, 2]
        b, a, h, _ = history.shape
        parts = [moved, torch.stack([torch.cos(turn), torch.sin(turn), valid], dim=-1)]
        parts += [self._which.expand(b, a, h, h), agents[:, :, None].expand(b, a, h, agents.shape[-1])]
        return torch.cat(parts, dim=-1)


class PointNet(nn.Module):
    """A polyline's encoding: two rounds of a layer per point and the maximum over the points."""

    def __init__(self, features: int, width: int) -> None:
        super().__init__()
        half = width // 2
        self.first = nn.Sequential(nn.Linear(features, half), nn.LayerNorm(half), nn.ReLU())
        self.second = nn.Sequential(nn.Linear(2 * half, width), nn.LayerNorm(width), nn.ReLU())

    def forward(self, points: Tensor) -> Tensor:
        """(..., P, F) -> (..., width)."""
        own = self.first(points)
        shared = own.amax(dim=-2, keepdim=True).expand(own.shape)
        out: Tensor = self.second(torch.cat([own, shared], dim=-1)).amax(dim=-2)
        return out


class RelativeAttention(nn.Module):
    """Attention of agents to agents and lanes, with relative poses."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.before, self.after = nn.LayerNorm(width), nn.LayerNorm(width)
        self.query, self.key = nn.Linear(width, width), nn.Linear(width, width)
        self.value, self.bias = nn.Linear(width, width), nn.Linear(PAIR_WIDTH, HEADS)
        self.relative = nn.Linear(HEADS * PAIR_WIDTH, width)
        self.out = nn.Linear(width, width)
        self.feed = nn.Sequential(nn.Linear(width, 2 * width), nn.ReLU(), nn.Linear(2 * width, width))

    def forward(self, who: Tensor, where: Tensor, pairs: Tensor, mask: Tensor) -> Tensor:
        """One round.

        Args:
            who: (B, A, width).
            where: (B, L, width).
            pairs: (B, A, A + L, 32) encoded relative poses.
            mask: (B, 1, A + L, 1), a large negative number for padding.
        """
        b, a, width = who.shape
        own = self.before(who)
        tokens = torch.cat([own, where], dim=1)
        query = self.query(own).reshape(b, a, HEADS, -1).transpose(1, 2)
        key = self.key(tokens).reshape(b, tokens.shape[1], HEADS, -1).permute(0, 2, 3, 1)
        value = self.value(tokens).reshape(b, tokens.shape[1], HEADS, -1).transpose(1, 2)
        scores = query @ key / (width // HEADS) ** 0.5 + (self.bias(pairs) + mask).permute(0, 3, 1, 2)
        share = scores.softmax(dim=-1)
        found = (share @ value).transpose(1, 2).reshape(b, a, width)
        places = (share.transpose(1, 2) @ pairs).reshape(b, a, HEADS * PAIR_WIDTH)
        who = who + self.out(found + self.relative(places))
        out: Tensor = who + self.feed(self.after(who))
        return out


def _mlp(features: int, width: int) -> nn.Sequential:
    return nn.Sequential(nn.Linear(features, width), nn.ReLU(), nn.Linear(width, width), nn.ReLU())


def _turned(vectors: Tensor, ahead: Tensor) -> Tensor:
    """Vectors in frames whose x axis is given as cosine and sine."""
    x, y, cos, sin = vectors[..., 0], vectors[..., 1], ahead[..., 0], ahead[..., 1]
    return torch.stack([x * cos + y * sin, y * cos - x * sin], dim=-1)


def _unit(vectors: Tensor) -> Tensor:
    return vectors / (vectors * vectors).sum(dim=-1, keepdim=True).sqrt().clamp_min(TINY_M)


def _shape(points: Tensor, lanes: Tensor) -> Tensor:
    """(B, L, 19, F) a lane's segments in its own frame (first point, towards the last), with its attributes."""
    ahead = _unit(points[:, :, -1] - points[:, :, 0])[:, :, None]
    local = _turned(points - points[:, :, :1], ahead) / REACH_M
    step = (local[:, :, 1:] - local[:, :, :-1]) * SEGMENT_SCALE
    known = lanes[:, :, None].expand(-1, -1, step.shape[2], -1)
    return torch.cat([local[:, :, :-1], step, known], dim=-1)


def _plan(rolled: Tensor, place: Tensor, heading: Tensor, ahead: Tensor) -> Tensor:
    """(B, A, 16, 7) a roll-out in the agent's own frame: places, directions, steps and times."""
    local = _turned(rolled[..., :2] - place[:, :, None], ahead[:, :, None]) / REACH_M
    step = torch.cat([local[:, :, :1], local[:, :, 1:] - local[:, :, :-1]], dim=2) * STEP_SCALE
    turn = rolled[..., 2] - heading[..., None]
    time = (torch.arange(STEPS, dtype=rolled.dtype, device=rolled.device) / STEPS).expand(turn.shape)
    return torch.cat([local, step, torch.stack([torch.cos(turn), torch.sin(turn), time], dim=-1)], dim=-1)


def _corrected(rolled: Tensor, out: Tensor) -> Tensor:
    """A roll-out with its headings, and its speeds along and across them, corrected by the network."""
    change = out.reshape(rolled.shape)
    moved = torch.cumsum(change[..., :2], dim=2) * STEP_S
    cos, sin = torch.cos(rolled[..., 2]), torch.sin(rolled[..., 2])
    x = rolled[..., 0] + moved[..., 0] * cos - moved[..., 1] * sin
    y = rolled[..., 1] + moved[..., 0] * sin + moved[..., 1] * cos
    return torch.stack([x, y, rolled[..., 2] + change[..., 2]], dim=-1)


def _between_agents(place: Tensor, ahead: Tensor, speed: Tensor) -> Tensor:
    """(B, A, A, F) relative poses and velocities of agents; speeds in 10 m/s."""
    apart = _turned(place[:, None] - place[:, :, None], ahead[:, :, None])
    turn = _turned(ahead[:, None], ahead[:, :, None])
    far = (apart * apart).sum(dim=-1, keepdim=True).clamp_min(TINY_M**2).sqrt()
    velocity = turn * speed[:, None, :, None]
    relative = torch.stack([velocity[..., 0] - speed[:, :, None], velocity[..., 1]], dim=-1)
    close = [torch.exp(-far / NEAR_AGENT_M), torch.exp(-far / FAR_AGENT_M)]
    return torch.cat([apart / REACH_M, turn, far / REACH_M, *close, relative, velocity, torch.ones_like(far)], dim=-1)


def _along_lanes(place: Tensor, ahead: Tensor, points: Tensor) -> Tensor:
    """(B, A, L, F) each lane's nearest point and its end, in each agent's frame."""
    b, a = place.shape[:2]
    count, length = points.shape[1], points.shape[2]
    x = points[..., 0][:, None] - place[:, :, None, None, 0]
    y = points[..., 1][:, None] - place[:, :, None, None, 1]
    nearest = (x * x + y * y).argmin(dim=-1, keepdim=True)
    here = torch.cat([x.gather(-1, nearest), y.gather(-1, nearest)], dim=-1)
    # The direction at a point is that of the segment that begins there; the last point's is the last segment's.
    tangent = _unit(points[:, :, 1:] - points[:, :, :-1])
    tangent = torch.cat([tangent, tangent[:, :, -1:]], dim=2)
    cos = tangent[..., 0][:, None].expand(b, a, count, length).gather(-1, nearest)
    sin = tangent[..., 1][:, None].expand(b, a, count, length).gather(-1, nearest)
    frame = ahead[:, :, None]
    end = _turned(torch.stack([x[..., -1], y[..., -1]], dim=-1), frame)
    end_ahead = _turned(tangent[:, None, :, -1].expand(b, a, count, 2), frame)
    far = (here * here).sum(dim=-1, keepdim=True).clamp_min(TINY_M**2).sqrt()
    parts = [_turned(here, frame) / REACH_M, _turned(torch.cat([cos, sin], dim=-1), frame), far / REACH_M]
    parts += [
        torch.exp(-far / NEAR_LANE_M),
        torch.exp(-far / FAR_LANE_M),
        end / REACH_M,
        end_ahead,
        nearest / (length - 1.0),
    ]
    return torch.cat(parts, dim=-1)
