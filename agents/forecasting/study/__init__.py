"""Studies of forecasters: arms, tables, figures, and the time of a forecast."""

STUDIES = {"forecasting": "study", "forecasting-mornings": "mornings", "forecasting-mornings-long": "mornings_long"}
