"""Actors around the egos: their names, scripted actors, and the requests that SUMO carries out."""
