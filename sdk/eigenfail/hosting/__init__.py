"""A whole service on this machine, for as long as somebody needs it."""
