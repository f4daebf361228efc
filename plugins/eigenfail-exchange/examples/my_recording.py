"""Recorded traffic as a scenario: `truck` is driven by the planner.

python my_recording.py shows how long the recording stays valid for a planner, without noise.
See ../docs/recorded_traffic.md.
"""

from pathlib import Path
from typing import ClassVar

import numpy as np

from eigenfail import plugins
from eigenfail.values.arrays import Floats
from eigenfail.values.disturbance import POSITION
from eigenfail_exchange.recorded_traffic.scenario import RecordedTraffic, find_log_validity
from eigenfail_exchange.recorded_traffic.tracks import RecordedTracks, read_tracks

DISTANCES_M = (1.0, 2.0, 5.0, 10.0)


class MyRecording(RecordedTraffic):
    """A truck behind a car that slows down, and traffic around them."""

    tracks: ClassVar[RecordedTracks] = read_tracks(
        Path(__file__).with_name("my_recording.csv"), ego="truck"
    )


def drive(planner: str) -> Floats:
    """x and y of the ego at each step, with a planner and without noise. [m]"""
    chosen = plugins.load(plugins.PLANNERS, planner)
    simulator = plugins.load(plugins.SIMULATORS, "highway")()
    simulation = simulator.open(
        MyRecording(), MyRecording.Parameters(), chosen(chosen.Settings()), POSITION
    )
    seen = [simulation.reset(0)]
    while not seen[-1].ended:
        seen.append(simulation.step((0.0, 0.0)))
    simulation.close()
    return np.array([(each.ego.x_m, each.ego.y_m) for each in seen], np.float32)


if __name__ == "__main__":
    for planner in ("idm", "rulebook"):
        course = drive(planner)
        for distance_m in DISTANCES_M:
            valid_s = find_log_validity(MyRecording.tracks, course, distance_m)
            print(f"{planner}: within {distance_m:g} m of the recording for {valid_s:.1f} s")
