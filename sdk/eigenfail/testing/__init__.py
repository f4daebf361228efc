"""Conformance suites, one for each contract, for authors of plug-ins."""
