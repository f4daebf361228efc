"""Disturbances: their model, and where they come from."""
