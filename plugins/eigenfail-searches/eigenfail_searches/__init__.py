"""Methods: simulated annealing, the samplers of Optuna, Go-Explore, and chains of failures."""
