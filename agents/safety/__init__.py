"""Responsibility-sensitive safety (RSS): safe distances, a monitor, and a shield for any agent."""
