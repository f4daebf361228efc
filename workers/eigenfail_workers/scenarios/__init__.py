"""Scenarios, one a module: road, scripted actors, start and goal of the ego."""
