"""Conversion: files of OpenStreetMap, OpenDRIVE and SUMO become nets with right-hand traffic, by netconvert."""
