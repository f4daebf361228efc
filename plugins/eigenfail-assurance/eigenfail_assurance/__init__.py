"""Sensor requirements, risks and evidence from the campaigns of eigenfail."""
