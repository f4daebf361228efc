"""Fits of the disturbance model p(x) to logs of a sensor beside the truth."""
