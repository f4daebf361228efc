"""Searches for failures: simulated annealing, the samplers of Optuna, and Go-Explore."""
