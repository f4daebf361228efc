"""Planners: the systems under test. They receive their perception and nothing else."""
