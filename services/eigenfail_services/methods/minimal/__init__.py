"""Minimal failures: as little noise as still makes the ego collide."""
