"""Environments of Gymnasium, and policies in them, as systems under test."""
