"""Parking of karts: an expert that plans, learners of DPPO-IL, their curriculum and their study."""
