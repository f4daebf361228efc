"""A complete service on this machine, for as long as its owner runs."""
