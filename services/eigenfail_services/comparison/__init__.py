"""Several campaigns side by side: two groups, seeds, versions, methods, and where they fail."""
