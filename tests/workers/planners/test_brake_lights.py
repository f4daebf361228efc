"""Brake lights: seen, believed, and no reason for anything while they are off."""

import pytest
from msgspec import structs

from eigenfail.values.scene import Perception
from eigenfail_workers.planners.rulebook.settings import BrakeLightSettings, TrackerSettings
from eigenfail_workers.planners.rulebook.tracker import BrakeLightTracker, Tracker
from eigenfail_workers.planners.rulebook.traffic import needed_deceleration
from eigenfail_workers.planners.rulebook.values import Neighbour


def braking_car(car, deceleration_mps2, steps):
    """A car 60 m ahead at 12 m/s that brakes from the second second on."""
    now = car(60.0, 0.0)
    for step in range(steps):
        yield now
        speed = max(now.speed_mps - 0.1 * deceleration_mps2 * (step >= 20), 0.0)
        now = structs.replace(now, x_m=now.x_m + 0.1 * now.speed_mps, speed_mps=speed)


def followed(tracker, truck, cars):
    for step, seen in enumerate(cars):
        (track,) = tracker.update(Perception(0.1 * step, truck, (seen,), (1,))) or (None,)
        yield track, seen


def test_with_its_lights_on_a_track_follows_where_without_it_lags_behind(truck, car):
    cars = list(braking_car(car, 4.0, 45))
    watchful = BrakeLightTracker(TrackerSettings(), BrakeLightSettings(), 0.1)
    *_, (track, seen) = followed(watchful, truck, cars)
    assert watchful.lost == 0
    assert track.along.position_m == pytest.approx(seen.x_m, abs=2.5)
    assert track.along.velocity_mps == pytest.approx(seen.speed_mps, abs=5.0)
    *_, (blind, seen) = followed(Tracker(TrackerSettings(), 0.1), truck, cars)
    assert blind.along.velocity_mps - seen.speed_mps > 7.0


def test_the_lights_are_on_from_a_deceleration_on_and_while_it_lasts(truck, car):
    for deceleration_mps2, lit in ((0.9, set()), (1.1, {*range(21, 40)})):
        tracker = BrakeLightTracker(TrackerSettings(), BrakeLightSettings(), 0.1)
        cars = braking_car(car, deceleration_mps2, 40)
        on = {k for k, _ in enumerate(followed(tracker, truck, cars)) if tracker.braking}
        assert on == lit


def test_without_lights_it_is_the_tracker_bit_for_bit(truck, car):
    watchful = BrakeLightTracker(TrackerSettings(), BrakeLightSettings(), 0.1)
    plain = Tracker(TrackerSettings(), 0.1)
    for (one, _), (other, _) in zip(
        followed(watchful, truck, braking_car(car, 0.5, 60)),
        followed(plain, truck, braking_car(car, 0.5, 60)),
        strict=True,
    ):
        assert (one.along.position_m, one.along.p11) == (other.along.position_m, other.along.p11)


def test_who_brakes_is_taken_to_stop_by_hand():
    """At 12 m/s and 4 m/s² it stops after 18 m: the truck has 40 + 18 − 5 m for its 20 m/s."""
    steady = Neighbour(40.0, 0.0, 12.0)
    assert needed_deceleration(steady, 40.0, 20.0, 5.0) == pytest.approx(64.0 / 70.0)
    braking = structs.replace(steady, is_braking=True)
    assert needed_deceleration(braking, 40.0, 20.0, 5.0) == pytest.approx(400.0 / 106.0)
