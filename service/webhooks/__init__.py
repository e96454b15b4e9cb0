"""Webhooks: registered, and told of the ends of evaluations."""
