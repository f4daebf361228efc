"""Failures sampled with a conditional diffusion network."""
