"""Immutable values that cross borders: each module holds the values of one concept."""
