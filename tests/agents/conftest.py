"""Tests of agents: what they draw, they draw the same in every run."""

from __future__ import annotations

import pytest
import torch


@pytest.fixture(autouse=True)
def seeded() -> None:
    """Tensors drawn without a generator of their own."""
    torch.manual_seed(0)
