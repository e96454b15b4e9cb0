"""Challenges: rules, phases, teams, invitations, baselines, final boards."""
