"""Functions under test that take their time and hardly any of the processor's."""

import time

from eigenfail.functions import of_trajectory


def robustness(z) -> float:
    return 4.0 - float(z.max())


@of_trajectory
def brief(z):
    time.sleep(0.04)
    return robustness(z)


@of_trajectory
def long(z):
    time.sleep(0.12)
    return robustness(z)
