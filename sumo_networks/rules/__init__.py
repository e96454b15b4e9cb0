"""Geometry and right-of-way rules that criteria, rewards and sensors share."""
