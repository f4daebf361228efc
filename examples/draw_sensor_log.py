"""Write the log of a made-up sensor, for `eigenfail noise fit`: draw_sensor_log.py FILE [SEED].

Its errors are correlated in time, and larger far away; one measurement in fifty is missed.
"""

import csv
import sys
from pathlib import Path

import numpy as np

TRACKS, STEP_S = 40, 0.1
CORRELATION = np.array([0.7, 0.4])
SLOPES, BASES_M = np.array([0.03, 0.01]), np.array([0.6, 0.15])
COLUMNS = ("track", "time_s", "dx_m", "dy_m", "seen_dx_m", "seen_dy_m")


def main() -> None:
    """Draw tracks of vehicles, and what the sensor sees of them."""
    random = np.random.default_rng(int(sys.argv[2]) if len(sys.argv) > 2 else 0)
    with Path(sys.argv[1]).open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(COLUMNS)
        for track in range(TRACKS):
            position = np.array([random.uniform(20.0, 90.0), random.choice([-3.5, 0.0, 3.5])])
            speed = np.array([random.uniform(-8.0, 3.0), random.uniform(-0.3, 0.3)])
            u = random.standard_normal(2)
            for step in range(int(random.integers(50, 120))):
                seen = position + (SLOPES * np.abs(position) + BASES_M) * u
                measured = ("", "") if random.uniform() < 0.02 else seen.round(3).tolist()
                table.writerow((track, round(STEP_S * step, 3), *position.round(3), *measured))
                position = position + STEP_S * speed
                u = CORRELATION * u + np.sqrt(1.0 - CORRELATION**2) * random.standard_normal(2)


if __name__ == "__main__":
    main()
