"""Forecasters of traffic speeds: segments of a road, minutes ahead."""
