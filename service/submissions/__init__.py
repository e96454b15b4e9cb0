"""Agents and their submissions, and what they may observe."""
