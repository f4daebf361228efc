"""A regression gate: what became of known failures, and what is new, under another planner."""
