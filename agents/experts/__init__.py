"""Rule-based drivers: autopilot, PDM-Closed, IDM, and two baselines that must fail."""
