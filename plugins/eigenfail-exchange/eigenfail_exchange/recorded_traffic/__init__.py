"""Recorded traffic as scenarios: tracks of vehicles are read, checked and replayed."""
