"""Conformance suites: one for each contract, for whoever implements it."""
