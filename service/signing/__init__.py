"""Signatures of records: the service's keys, and their public parts."""
