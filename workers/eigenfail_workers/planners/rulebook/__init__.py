"""The planner `rulebook`, built as the paper describes the commercial planner.

Filtered perception, driving modes, long-horizon candidates ordered by a hierarchy of rules, a
quadratic program that refines the chosen one, and safety overrides above all.
"""
