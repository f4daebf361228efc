"""Keys: made, and held against what somebody shows."""
