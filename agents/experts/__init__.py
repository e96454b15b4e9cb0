"""Drivers by rule: the autopilot, PDM-Closed, IDM, and the baselines that crash."""
