"""Imported by the server that the worker processes of tests are forked from: hundreds that would each load torch."""

from __future__ import annotations

import dohyo.agents.experts.autopilot
import dohyo.agents.learning.gymnasium.task
import dohyo.agents.mcts.mbappe
import dohyo.evaluation.running.executors
import dohyo.sumo_networks.envs.driving_env
import dohyo.sumo_networks.preloaded  # noqa: F401
from tests import compile_once

compile_once.install()
