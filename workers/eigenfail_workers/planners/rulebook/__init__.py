"""The planner `rulebook`, built as the paper describes the commercial one.

Filtered perception, driving modes, long-horizon candidates ordered by a hierarchy of rules, a
quadratic program that refines the chosen one, and safety overrides above all.
"""
