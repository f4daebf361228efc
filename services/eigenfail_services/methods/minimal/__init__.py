"""Minimal failures: the least noise that makes the ego collide."""
