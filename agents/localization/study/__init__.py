"""The study of filters: synthetic journeys, tables, figures."""
