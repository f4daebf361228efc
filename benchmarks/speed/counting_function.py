"""A function under test that takes its time, and counts in a file how often it is called."""

import os
import time

from eigenfail.functions import Noise, of_trajectory

COUNTS = "COUNTED_CALLS"
TAKES_S = 0.02


@of_trajectory
def robustness(z: Noise) -> float:
    """Never a failure."""
    # Appended in one write: several processes count at a time.
    calls = os.open(os.environ[COUNTS], os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    os.write(calls, b".")
    os.close(calls)
    time.sleep(TAKES_S)
    return 10.0 + abs(float(z[0, 0]))
