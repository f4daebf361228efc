"""Contacts between two samples: the same outcome whatever the step is."""

import csv
from pathlib import Path

import pytest

from eigenfail import plugins
from eigenfail.exchange.recorded_traffic import RecordedTraffic
from eigenfail.exchange.tracks import read_tracks
from eigenfail.settings import read_settings
from eigenfail.testing.simulation import Cruise
from eigenfail.values import POSITION, Measures, Observation
from eigenfail_workers.measures.recorder import Recorder

SIMULATORS = ("highway", "point_mass")


def write(path: Path, aside_m: float) -> Path:
    """A truck at 25 m/s, and a car that comes towards it at 25 m/s, at 20 Hz for 10 s."""
    with path.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(("id", "time_s", "x_m", "y_m"))
        for k in range(201):
            at_s = round(0.05 * k, 2)
            rows.writerow(("truck", at_s, 25.0 * at_s, 0.0))
            rows.writerow(("wrongway", at_s, 160.0 - 25.0 * at_s, aside_m))
            rows.writerow(("far", at_s, 2000.0 + 20.0 * at_s, 3.5))
    return path


def drive(
    path: Path, dt_s: float, simulator: str, planner: str | None = None
) -> tuple[Observation, Measures]:
    """Last observation and measures of a run without noise; default: at constant speed."""

    class Recording(RecordedTraffic):
        tracks = read_tracks(path, ego="truck", dt_s=dt_s)

    driver = Cruise()
    if planner is not None:
        made = plugins.load(plugins.PLANNERS, planner)
        driver = made(read_settings(made.Settings, {}, "planner_settings"))
    opened = plugins.load(plugins.SIMULATORS, simulator)()
    simulation = opened.open(Recording(), Recording.Parameters(), driver, POSITION)
    recorder, now = Recorder(), simulation.reset(1)
    recorder.observe(now, dt_s)
    while not now.ended:
        now = simulation.step((0.0, 0.0))
        recorder.add_disturbance((0.0, 0.0), (1.0, 1.0))
        assert recorder.observe(now, dt_s) == now
    return now, recorder.measures(dt_s)


@pytest.mark.parametrize("simulator", SIMULATORS)
@pytest.mark.parametrize("planner", ["idm", "rulebook", None])
@pytest.mark.parametrize("dt_s", [0.1, 0.2, 0.25, 0.4, 0.5, 1.0])
def test_wrong_way_car_is_struck_at_any_step(tmp_path, simulator, planner, dt_s) -> None:
    last, measures = drive(write(tmp_path / "headon.csv", 0.0), dt_s, simulator, planner)
    assert last.collided
    assert measures.robustness_m == 0.0
    # 160 m less the halves of two footprints at 50 m/s: about 3 s, later if a planner brakes
    assert 2.9 <= measures.collided_s <= 3.6 + dt_s
    assert measures.severity is not None
    assert measures.severity > 25.0**2
    assert measures.min_ttc_s is not None
    assert measures.min_ttc_s <= 0.11


@pytest.mark.parametrize("simulator", SIMULATORS)
@pytest.mark.parametrize("dt_s", [0.2, 0.5, 1.0])
def test_near_pass_between_samples_is_measured(tmp_path, simulator, dt_s) -> None:
    """The smallest distance is the room beside the car, whatever the samples show."""
    path = write(tmp_path / "pass.csv", 3.0)
    fine, coarse = (drive(path, each, simulator) for each in (0.05, dt_s))
    assert not coarse[0].collided
    assert coarse[1].robustness_m == pytest.approx(fine[1].robustness_m, abs=0.002)
    assert coarse[1].robustness_m < 1.1
