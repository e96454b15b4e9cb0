"""Parking: a kart with a radar in a lot, in numba, without SUMO."""
