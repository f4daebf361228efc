"""Comparison of several campaigns: two groups, seeds, versions, methods and failure modes."""
