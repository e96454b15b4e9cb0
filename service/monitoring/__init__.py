"""Health and metrics of the service, for those who run it."""
