"""Rendering of a network and its traffic, for the bird's-eye view, the cameras and the pictures from above."""
