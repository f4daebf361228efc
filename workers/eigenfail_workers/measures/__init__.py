"""Measures of an episode: distances, surrogate safety measures, and the record of its steps."""
