"""Maintenance of a database: check, repair, backup, restoration and pruning."""
