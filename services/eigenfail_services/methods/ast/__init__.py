"""Adaptive stress testing: reinforcement learning against the planner."""
