"""Planners: systems under test. They see their perception and nothing else."""
