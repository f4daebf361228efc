"""A regression gate: known failures and new ones under another version of a planner."""
