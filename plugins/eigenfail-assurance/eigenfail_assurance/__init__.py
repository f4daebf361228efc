"""Sensor requirements and evidence from the campaigns of eigenfail."""
