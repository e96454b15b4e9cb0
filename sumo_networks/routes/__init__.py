"""Routes: the reference path of a mission, and the search for it."""
