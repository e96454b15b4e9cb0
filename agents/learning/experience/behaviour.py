"""Behaviour: who chooses the actions of an episode or of a step. To be asked for a label is another thing."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np
import torch
from tensordict import TensorDict
from torch import Tensor

from dohyo.sumo_networks.arrays import BoolArray, IntArray

POLICY, DEMONSTRATOR = 0, 1
"""Sources of a transition."""

Act = Callable[[TensorDict], TensorDict]
"""Policy: observations by name (N,) -> "action", in the action space, and what else it wants to be kept."""
_MIXED = 1  # separates this random stream from that of the seeds


class Behaviour(Protocol):
    """Chooses the actions of N rows."""

    def begin(self, rows: BoolArray, episodes: IntArray) -> None:
        """Prepares for new episodes.

        Args:
            rows: (N,) rows in which one begins.
            episodes: (N,) number of every row's episode in the run.
        """

    def asked(self, count: int) -> BoolArray:
        """(N,) rows whose expert is asked for a label of the present observation; `count` is N."""

    def act(self, observation: TensorDict, label: Tensor, labelled: Tensor) -> TensorDict:
        """Chooses.

        Args:
            observation: By name, (N,).
            label: (N, ...) the expert's actions; arbitrary where there is none.
            labelled: (N,) whether the expert gave one.

        Returns:
            "action" (N, ...), "source" (N,) uint8, and what else is to be kept of each step.
        """


class PolicyBehaviour:
    """The policy drives.

    Attributes:
        labels: Whether the expert is asked at every step.
    """

    def __init__(self, policy: Act, labels: bool = False) -> None:
        self._policy, self.labels = policy, labels

    def begin(self, rows: BoolArray, episodes: IntArray) -> None:
        """See `Behaviour`."""

    def asked(self, count: int) -> BoolArray:
        """See `Behaviour`."""
        return np.full(count, self.labels)

    def act(self, observation: TensorDict, label: Tensor, labelled: Tensor) -> TensorDict:
        """See `Behaviour`."""
        chosen = self._policy(observation)
        chosen["source"] = torch.full(observation.batch_size, POLICY, dtype=torch.uint8)
        return chosen


class EpisodeMixture:
    """The expert drives whole episodes with a probability, the policy the others; where the expert is silent, too.

    With a share of 1 it is the demonstrator alone. Source: GPPO (Albilani 2023), GRI (Chekroun et al. 2021).

    Attributes:
        share: Probability that the expert drives an episode that begins now.
        labels: Whether the expert is asked in the policy's episodes, too.
    """

    def __init__(self, policy: Act, seed: int, share: float, labels: bool = False) -> None:
        """Prepares.

        Args:
            policy: Drives the other episodes.
            seed: Of the run; with an episode's number it decides who drives.
            share: Of the expert's episodes.
            labels: Whether the expert is always asked.
        """
        self._policy, self._seed, self.share, self.labels = policy, seed, share, labels
        self._guided: BoolArray = np.zeros(0, np.bool_)

    def begin(self, rows: BoolArray, episodes: IntArray) -> None:
        """See `Behaviour`."""
        if len(self._guided) != len(rows):
            self._guided = np.zeros(len(rows), np.bool_)
        for row in np.flatnonzero(rows).tolist():
            draw = np.random.default_rng([_MIXED, self._seed, int(episodes[row])]).random()
            self._guided[row] = draw < self.share

    def asked(self, count: int) -> BoolArray:
        """See `Behaviour`."""
        return np.ones(count, np.bool_) if self.labels else self._guided.copy()

    def act(self, observation: TensorDict, label: Tensor, labelled: Tensor) -> TensorDict:
        """See `Behaviour`."""
        return _replaced(self._policy(observation), label, labelled & torch.from_numpy(self._guided))


class UncertaintyGate:
    """The expert drives the steps at which the policy is uncertain. Source: RLfOLD (Coelho et al. 2024).

    Attributes:
        threshold: Uncertainty above which the expert drives.
    """

    def __init__(
        self,
        policy: Act,
        uncertainty: Callable[[TensorDict], Tensor],
        threshold: float,
        components: Sequence[int] | None = None,
    ) -> None:
        """Prepares.

        Args:
            policy: Drives where it is certain.
            uncertainty: The policy's answer (N,) -> (N,) its uncertainty, such as the mean standard deviation.
            threshold: See the class.
            components: Of the action, that the expert then decides; None: all of it.
        """
        self._policy, self._uncertainty, self.threshold = policy, uncertainty, threshold
        self._components = None if components is None else list(components)

    def begin(self, rows: BoolArray, episodes: IntArray) -> None:
        """See `Behaviour`."""

    def asked(self, count: int) -> BoolArray:
        """See `Behaviour`; an expert with a state of its own must see every step."""
        return np.ones(count, np.bool_)

    def act(self, observation: TensorDict, label: Tensor, labelled: Tensor) -> TensorDict:
        """See `Behaviour`."""
        chosen = self._policy(observation)
        uncertain = labelled & (self._uncertainty(chosen) > self.threshold)
        return _replaced(chosen, label, uncertain, self._components)


def demonstrator(policy: Act) -> EpisodeMixture:
    """The expert drives every episode; the policy, where the expert is silent."""
    return EpisodeMixture(policy, seed=0, share=1.0)


def _replaced(chosen: TensorDict, label: Tensor, rows: Tensor, components: Sequence[int] | None = None) -> TensorDict:
    """The policy's choice, with the expert's in some rows; in some components of the action, or all."""
    if not rows.any():
        chosen["source"] = torch.full(rows.shape, POLICY, dtype=torch.uint8)
        return chosen
    action = chosen["action"].clone()
    if components is None:
        action[rows] = label[rows].to(action)
    else:
        for number in components:
            action[rows, number] = label[rows, number].to(action)
    chosen["action"] = action
    chosen["source"] = torch.where(rows, DEMONSTRATOR, POLICY).to(torch.uint8)
    return chosen
