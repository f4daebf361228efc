"""Write the log of a made-up sensor, for `eigenfail noise fit`: draw_sensor_log.py FILE [SEED].

Errors of position and speed grow with the distance; errors of position are also correlated in time.
Vehicles are missed for some steps in a row, far ones more often, and sometimes a vehicle is seen
that is not there.
"""

import csv
import sys
from pathlib import Path

import numpy as np

TRACKS, STEP_S, DRIVE_STEPS = 100, 0.1, 3000
CORRELATION = np.array([0.7, 0.4, 0.0])
SLOPES, BASES = np.array([0.03, 0.01, 0.005]), np.array([0.6, 0.15, 0.3])
MISSES, MISSES_PER_M, MISSED_STEPS = 0.005, 0.0004, 4.0
GHOSTS, GHOST_STEPS, GHOST_AHEAD_M = 0.01, 3.0, 35.0
COLUMNS = (
    "track",
    "time_s",
    "dx_m",
    "dy_m",
    "seen_dx_m",
    "seen_dy_m",
    "speed_mps",
    "seen_speed_mps",
)


def main() -> None:
    """Draw tracks of vehicles, and what the sensor sees of them and of ghosts."""
    random = np.random.default_rng(int(sys.argv[2]) if len(sys.argv) > 2 else 0)
    with Path(sys.argv[1]).open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(COLUMNS)
        for track in range(TRACKS):
            first = int(random.integers(DRIVE_STEPS))
            position = np.array([random.uniform(20.0, 90.0), random.choice([-3.5, 0.0, 3.5])])
            rate = np.array([random.uniform(-8.0, 3.0), random.uniform(-0.3, 0.3)])
            u, missed = random.standard_normal(3), False
            for step in range(first, first + int(random.integers(50, 120))):
                apart_m = float(np.hypot(*position))
                begins = MISSES + MISSES_PER_M * apart_m
                missed = random.uniform() < (1.0 - 1.0 / MISSED_STEPS if missed else begins)
                true = np.array([*position, 25.0 + rate[0]])
                seen = true + (SLOPES * [*np.abs(position), apart_m] + BASES) * u
                dx, dy, speed = ("",) * 3 if missed else seen.round(3).tolist()
                place = true[:2].round(3)
                table.writerow((track, at(step), *place, dx, dy, round(true[2], 3), speed))
                position = position + STEP_S * rate
                u = CORRELATION * u + np.sqrt(1.0 - CORRELATION**2) * random.standard_normal(3)
        write_ghosts(table, random)


def write_ghosts(table, random: np.random.Generator) -> None:
    """Draw ghosts that stand still ahead of the ego."""
    number, lasts, place_m = 0, False, 0.0
    for step in range(DRIVE_STEPS):
        before, stays = lasts, 1.0 - 1.0 / GHOST_STEPS
        lasts = random.uniform() < (stays if before else GHOSTS)
        if lasts and not before:
            number, place_m = number + 1, round(GHOST_AHEAD_M * random.uniform(0.5, 1.5), 3)
        if lasts:
            table.writerow((f"ghost {number}", at(step), "", "", place_m, 0.0, "", ""))


def at(step: int) -> float:
    """Return the time of a step. [s]"""
    return round(STEP_S * step, 3)


if __name__ == "__main__":
    main()
