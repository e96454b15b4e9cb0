"""DrQ: SAC whose targets and losses are means over K = M = 2 random shifts. Source: Kostrikov et al. 2021."""

from __future__ import annotations

from typing import Any

import torch
from tensordict import TensorDictBase
from torch import Tensor

from dohyo.agents.learning.algorithms.off_policy import Augment
from dohyo.agents.learning.algorithms.sac import Sac

VIEWS = 2


class Drq(Sac):
    """See the module."""

    only_learns = (*Sac.only_learns, "_view")

    def __init__(self, *args: Any, augment: Augment, **options: Any) -> None:
        """See `Sac`; `augment` is drawn anew for every view."""
        self._view = augment
        super().__init__(*args, **options)

    def learn(self, batch: TensorDictBase) -> dict[str, Tensor]:
        """See `OffPolicy`."""
        views = [self._view(batch) for _ in range(VIEWS)]
        alpha = self.log_alpha.detach().exp()
        targets = torch.stack([self.target_values(view, alpha) for view in views]).mean(dim=0)
        return self.learn_towards(torch.cat(views), targets.repeat(VIEWS))
