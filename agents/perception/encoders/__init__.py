"""Encoders: networks from an observation's pictures, or its waypoints, to a vector of features."""
