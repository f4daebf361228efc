"""Failures sampled from a mixture of normals that is fitted to the least robust episodes."""
