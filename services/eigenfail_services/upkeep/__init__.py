"""Maintenance of a database: check, backup, restoration, vacuum and pruning."""
