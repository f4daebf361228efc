"""The emergency brake: when it comes, and when it goes."""

from eigenfail_workers.planners.rulebook.planner import EmergencyBrake, fall_back
from eigenfail_workers.planners.rulebook.settings import OverrideSettings
from eigenfail_workers.planners.rulebook.values import Neighbour


def lead(gap_m, speed_mps=12.0):
    return Neighbour(gap_m, 0.0, speed_mps)


def test_it_brakes_from_one_threshold_to_another():
    """Closing at 12 m/s with 3 m to spare: 3.5 m/s² at 23.6 m, 2.0 m/s² at 39 m."""
    brake = EmergencyBrake(OverrideSettings())
    assert not brake.update(lead(24.0), 24.0)
    assert brake.update(lead(23.0), 24.0)
    assert brake.update(lead(38.0), 24.0)
    assert not brake.update(lead(40.0), 24.0)
    assert not brake.update(lead(38.0), 24.0)


def test_time_to_collision_calls_for_it_at_any_speed_difference():
    patient = OverrideSettings(brake_at_mps2=10.0, brake_at_s=2.0, margin_m=0.0)
    assert EmergencyBrake(patient).update(lead(3.0, 22.0), 24.0)
    assert not EmergencyBrake(patient).update(lead(5.0, 22.0), 24.0)


def test_without_a_lead_there_is_nothing_to_brake_for():
    brake = EmergencyBrake(OverrideSettings())
    assert brake.update(lead(10.0), 24.0)
    assert not brake.update(None, 24.0)
    assert not brake.update(lead(38.0), 24.0)


def test_the_fallback_never_accelerates():
    assert fall_back(0.5) == 0.0
    assert fall_back(-2.0) == -2.0
