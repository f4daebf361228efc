"""Fits of the disturbance model p(x) to logs of a sensor and the true positions."""
