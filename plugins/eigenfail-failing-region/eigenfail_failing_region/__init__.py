"""The failing region: ranges of scenario parameters with a raised failure rate."""
