"""PRIBOOT: a driver that learns waypoints from few demonstrations and a coloured view from above."""
