"""Frozen nouns that cross borders: each module holds those of one concept."""
