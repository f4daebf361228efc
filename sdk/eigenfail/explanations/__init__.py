"""Stored episodes told: run again from their noise, explained by the planner, put into words."""
