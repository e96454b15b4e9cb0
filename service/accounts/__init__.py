"""Accounts: tokens, their roles, and who may see and change what."""
