"""Migrations: how tables come to be what the models say."""
