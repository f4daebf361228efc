"""Disturbances: their standard deviations and their sources."""
