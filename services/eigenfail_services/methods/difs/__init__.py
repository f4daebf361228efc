"""Diffusion-based failure sampling: a generative model of the noise that leads to failures."""
