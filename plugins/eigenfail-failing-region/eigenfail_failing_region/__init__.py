"""The failing region: the ranges of scenario parameters in which the episodes of campaigns fail."""
