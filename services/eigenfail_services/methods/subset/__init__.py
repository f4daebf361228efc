"""Subset simulation."""
