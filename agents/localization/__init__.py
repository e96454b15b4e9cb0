"""Localization: where a vehicle is, from a cheap IMU and a GNSS receiver."""
