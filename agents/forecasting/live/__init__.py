"""Forecasts of a table that grows, with intervals that follow what is measured."""
