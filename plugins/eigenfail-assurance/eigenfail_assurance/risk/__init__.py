"""How often a planner fails on the road: encounters in an hour times P(failure) in each."""
