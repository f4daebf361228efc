"""Scenarios: a road, the actors' scripted behaviour, the ego's start and goal; one a file."""
