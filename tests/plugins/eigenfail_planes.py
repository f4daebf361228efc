"""Functions under test that fail beyond a plane, whatever the number of channels."""

from math import sqrt

from eigenfail.functions import of_trajectory


@of_trajectory
def far(z):
    """P(failure) = Phi(-2) under p(x): the last channel alone decides."""
    return 2.0 - z[:, -1].sum() / sqrt(len(z))
