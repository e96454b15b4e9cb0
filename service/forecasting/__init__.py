"""Days of forecasts as episodes: forecasters of all three kinds of submission."""
