"""Recording: the autopilot's drives with scripted events, as views, measurements and waypoints."""
