"""Files of runs: settings, checkpoints, metrics, cards."""
