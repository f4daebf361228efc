"""Episodes of a function of a noise trajectory: no road, no planner, nothing of driving."""
