"""Runs episodes: simulators, scenarios, planners and the worker around them."""
