"""Option-critic over given options: targets and losses of choice and termination, and the replay of options.

Q_Omega is learned by Q-learning on whole options (SMDP), the terminations beta by the gradient of the advantage of
continuing, with a deliberation cost, and the options' own policies by the intra-option gradient. Sources: Bacon et al.
2017; Harb et al. 2018 (deliberation cost); Albilani 2023, equations 6.6 to 6.8 and algorithm 11, of which 6.8 is
restored.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from tensordict import TensorDict
from torch import Tensor
from torchrl.data import LazyTensorStorage, TensorDictReplayBuffer

UNAVAILABLE = -1e9


def best_value(q: Tensor, available: Tensor) -> Tensor:
    """(N,) value of the best option that may begin.

    Args:
        q: (N, O).
        available: (N, O) bool.
    """
    return q.masked_fill(~available, UNAVAILABLE).max(dim=1).values


def smdp_target(rewards: Tensor, ticks: Tensor, after: Tensor, terminated: Tensor, gamma: float) -> Tensor:
    """(N,) target of Q_Omega(s, o): the rewards while o ran, and the best value where it ended.

    R + gamma^k max_o' Q(s', o'); the thesis's equation 6.8, corrected.

    Args:
        rewards: (N,) sum of gamma^i r_i over the option's k ticks.
        ticks: (N,) k.
        after: (N,) `best_value` where it ended.
        terminated: (N,) bool, whether the episode ended there by itself.
        gamma: Discount per tick.
    """
    return rewards + torch.where(terminated, torch.zeros_like(after), gamma**ticks * after)


def arrival_value(q_option: Tensor, beta: Tensor, best: Tensor) -> Tensor:
    """(N,) U(s', o): value of arriving in a state with an option, which continues or ends there.

    Args:
        q_option: (N,) Q_Omega(s', o).
        beta: (N,) beta(s', o).
        best: (N,) `best_value` there.
    """
    return (1.0 - beta) * q_option + beta * best


def termination_loss(beta: Tensor, q_option: Tensor, best: Tensor, cost: float) -> Tensor:
    """Loss of terminations: an option ends the less, the better it is than the best one; equation 6.7.

    Args:
        beta: (N,) beta(s', o).
        q_option: (N,) Q_Omega(s', o), taken as given.
        best: (N,) `best_value` there, taken as given.
        cost: eta, the deliberation cost.
    """
    return (beta * (q_option.detach() - best.detach() + cost)).mean()


def intra_option_loss(log_prob: Tensor, arrived: Tensor, q_option: Tensor) -> Tensor:
    """Loss of the options' policies: raises the probability of actions better than their option's value; equation 6.6.

    Q_Omega(s, o) is the baseline of Q_U(s, o, a).

    Args:
        log_prob: (N,) of the actions taken, by their options' policies.
        arrived: (N,) r + gamma U(s', o), an estimate of Q_U(s, o, a).
        q_option: (N,) Q_Omega(s, o).
    """
    return -(log_prob * (arrived - q_option).detach()).mean()


class OptionReplay:
    """Replay memory of finished options, on TorchRL's; drawn from torch's generator, with replacement."""

    def __init__(self, size: int) -> None:
        """Makes the memory.

        Args:
            size: Capacity.
        """
        self._buffer = TensorDictReplayBuffer(storage=LazyTensorStorage(size))

    def __len__(self) -> int:
        return len(self._buffer)

    def add(self, options: TensorDict) -> None:
        """Adds finished options in the place of the oldest.

        Args:
            options: (N,) "state" (D,) at the begin, "option", "total" (discounted rewards while it ran), "ticks" (its
                duration), "after" (D,) the state at the end, "available" (O,) options that may begin there, and
                "terminated".
        """
        self._buffer.extend(options)

    def sample(self, count: int) -> TensorDict:
        """Random batch."""
        batch: TensorDict = self._buffer.sample(count)
        return batch

    def state(self) -> dict[str, Any]:
        """State for `restore`; the rows that are filled, in their places."""
        rows = self._buffer[:].to_dict() if len(self) else {}
        return {"rows": rows, "writer": self._buffer.writer.state_dict()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restores a state."""
        if state["rows"]:
            count = len(state["rows"]["option"])
            self._buffer.extend(TensorDict(state["rows"], [count]))
        self._buffer.writer.load_state_dict(state["writer"])
