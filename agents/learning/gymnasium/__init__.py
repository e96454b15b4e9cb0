"""Any gymnasium environment as a task."""
