"""Studies of the speed planner: mornings under each plan, held-out episodes, calibration of the freeway."""

STUDIES = {"dissipation": "study"}
