"""The highway drive: its staging by hand, its follower, and causes of constructed collisions."""

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eigenfail import plugins
from eigenfail.contracts import ReactiveSituation
from eigenfail.errors import InvalidValue
from eigenfail.settings import read_settings
from eigenfail.values.channels import Channel
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.episode import EpisodeSetup, EpisodeTask, TrajectorySource
from eigenfail.values.scene import Control
from eigenfail_workers.engine import Engine
from eigenfail_workers.measures.geometry import find_hidden
from eigenfail_workers.planners.rulebook.settings import RulebookSettings
from eigenfail_workers.scenarios.highway_drive import (
    CUT_IN_STEP,
    CUTTING_IN,
    FOLLOWER_LAW,
    FOLLOWING,
    LEADING,
    PASSING,
    REVEAL_STEP,
    SLOW,
    HighwayDrive,
    HighwayDriveParameters,
)
from eigenfail_workers.scenarios.traffic import FollowingCar, PlannedCar, SpeedChange
from eigenfail_workers.simulators.point_mass import PointMassSimulator

HALF_LENGTHS_M = 10.5


def situation(**parameters):
    read = read_settings(HighwayDriveParameters, parameters, "scenario_parameters")
    return HighwayDrive()(read, 0)


def at(ego, x_m, speed_mps):
    return msgspec.structs.replace(ego, x_m=x_m, speed_mps=speed_mps)


def drive(now, speed_mps=24.0, later_mps=None):
    """Positions of all cars relative to an ego at constant speed, at each step.

    After the reveal has begun the ego may have another speed.
    """
    speeds = [speed_mps] * REVEAL_STEP
    speeds += [speed_mps if later_mps is None else later_mps] * (now.steps - REVEAL_STEP)
    places = np.cumsum(speeds) * 0.1
    traffic, course = now.start_traffic(), [dict(enumerate(now.actors, 1))]
    for step, (x_m, now_mps) in enumerate(zip(places, speeds, strict=True), 1):
        ego = at(now.ego, float(x_m), now_mps)
        there = traffic.advance(step, ego)
        course.append(
            {n: msgspec.structs.replace(c, x_m=c.x_m - ego.x_m) for n, c in there.items()}
        )
    return course


def test_the_phantom_by_hand():
    now = situation(passing_offset_m=2.95)
    assert isinstance(now, ReactiveSituation)
    course = drive(now)
    passing = [there.get(PASSING) for there in course]
    assert passing[0].x_m == pytest.approx(-22.0 + HALF_LENGTHS_M)
    assert (passing[0].y_m, passing[40].y_m, passing[70].y_m) == pytest.approx((3.5, 2.95, 2.95))
    assert passing[20].y_m == pytest.approx((3.5 + 2.95) / 2.0)
    assert passing[50].x_m == pytest.approx(-11.5 + 4.0 * 5.0)
    # From 28 m/s it brakes by 4 m/s²: as fast as the truck after 1 s, having won 2 m.
    assert passing[60].x_m == pytest.approx(8.5 + 2.0)
    assert passing[60].speed_mps == pytest.approx(24.0)
    assert passing[95].speed_mps == pytest.approx(10.0)
    following = [there.get(FOLLOWING) for there in course]
    assert {round(car.x_m, 9) for car in following[:70]} == {-9.0 - HALF_LENGTHS_M}


def test_the_reveal_by_hand():
    now = situation(slow_gap_m=78.0)
    course = drive(now)
    assert LEADING not in course[69]
    assert course[70][LEADING].x_m == pytest.approx(25.0 + HALF_LENGTHS_M)
    assert (course[90][LEADING].y_m, course[120][LEADING].y_m) == pytest.approx((0.0, 3.5))
    first = min(step for step, there in enumerate(course) if SLOW in there)
    # 12 m/s slower, and 78 m ahead when the reveal begins.
    gap_m = course[first][SLOW].x_m - HALF_LENGTHS_M
    assert gap_m == pytest.approx(78.0 - 12.0 * (first - 70) * 0.1)
    hidden = msgspec.structs.replace(course[first][SLOW], x_m=course[first][SLOW].x_m + 1.2)
    for step, slow, is_hidden in (
        (first, course[first][SLOW], False),
        (first - 1, hidden, True),
    ):
        assert (1 in find_hidden(now.ego, (course[step][LEADING], slow))) is is_hidden


def test_the_cut_in_by_hand():
    """At 24 and 12 m/s a gap of 94 m is one of 58 m after 3 s; 3 s later the car is across."""
    course = drive(situation(cut_in_distance_m=58.0))
    assert CUTTING_IN not in course[269]
    assert course[270][CUTTING_IN].x_m == pytest.approx(94.0 + HALF_LENGTHS_M)
    assert course[300][CUTTING_IN].x_m == pytest.approx(58.0 + HALF_LENGTHS_M)
    assert course[300][CUTTING_IN].y_m == pytest.approx(3.5)
    assert course[302][CUTTING_IN].y_m < 3.5
    assert course[330][CUTTING_IN].y_m == pytest.approx(2.1)


def test_cars_that_are_far_behind_or_ahead_go_for_good():
    """The passing car is 3.5 m behind at 9.5 s and loses 14 m/s: it is 20 m behind at 10.68 s."""
    course = drive(situation())
    assert course[95][PASSING].x_m == pytest.approx(-3.5 - HALF_LENGTHS_M)
    assert find_steps(course, PASSING) == [*range(107)]
    following = [there[FOLLOWING].x_m for there in course if FOLLOWING in there]
    assert find_steps(course, FOLLOWING) == [*range(len(following))]
    # It falls back by less than 1 m in a step.
    assert -20.0 <= following[-1] + HALF_LENGTHS_M < -19.0
    # From 7 s on the leading car wins 9 m/s: 25 m ahead then, it is 150 m ahead at 20.89 s.
    course = drive(situation(), later_mps=15.0)
    assert course[208][LEADING].x_m == pytest.approx(25.0 + 9.0 * 13.8 + HALF_LENGTHS_M)
    assert find_steps(course, LEADING) == [*range(70, 209)]


def test_a_planned_car_ends_its_change_of_speed():
    car = PlannedCar(0.0, 0.0, 10.0, SpeedChange(1.0, 2.0, -4.0))
    assert car.find_state(3.0).x_m == pytest.approx(10.0 + (10.0 + 2.0) / 2.0 * 2.0)
    assert car.find_state(5.0).x_m == pytest.approx(22.0 + 4.0)
    assert car.find_state(5.0).speed_mps == pytest.approx(2.0)


def test_the_follower_reacts_by_its_law_after_its_delay():
    """The ego is 2 m/s slower from now on: the law asks for -2 m/s² and, for lost metres, more."""
    now = situation()
    follower = FollowingCar(now.actors[1], FOLLOWER_LAW, 0.1)
    speeds, gaps = [], []
    for step in range(1, 13):
        ego = at(now.ego, 22.0 * step * 0.1, 22.0)
        follower.follow(ego, 9.0)
        speeds.append(follower.state.speed_mps)
        gaps.append(ego.x_m - follower.state.x_m - HALF_LENGTHS_M)
    assert speeds[:10] == [24.0] * 10
    first_mps2, second_mps2 = (-2.0 + 0.15 * (gap - 9.0) for gap in gaps[:2])
    assert speeds[10] == pytest.approx(24.0 + 0.1 * first_mps2)
    assert speeds[11] == pytest.approx(24.0 + 0.1 * (first_mps2 + second_mps2))


def test_a_follower_needs_a_delay_of_a_step_at_least():
    """With one step, what is chosen after a step acts in the next one."""
    start = situation().actors[1]
    with pytest.raises(InvalidValue, match="at least one"):
        FollowingCar(start, FOLLOWER_LAW._replace(delay_steps=0), 0.1)
    follower = FollowingCar(start, FOLLOWER_LAW._replace(delay_steps=1), 0.1)
    ego = at(situation().ego, 0.0, 20.0)
    follower.follow(ego, 9.0)
    assert follower.state.speed_mps == 24.0
    follower.follow(ego, 9.0)
    assert follower.state.speed_mps < 24.0


def test_the_follower_has_limits_and_stops():
    now = situation()
    follower = FollowingCar(now.actors[1], FOLLOWER_LAW, 0.1)
    speeds = [24.0]
    for _ in range(70):
        follower.follow(at(now.ego, 0.0, 0.0), 9.0)
        speeds.append(follower.state.speed_mps)
    assert min(np.diff(speeds)) == pytest.approx(-0.5)
    assert speeds[-1] == 0.0


@given(st.lists(st.floats(-7.0, 1.5), min_size=42, max_size=42))
@settings(max_examples=30, deadline=None)
def test_some_car_is_always_there_and_a_car_that_has_gone_stays_away(asked):
    """Whatever the ego does: its acceleration is another one each second."""
    now = situation()
    traffic, ego = now.start_traffic(), now.ego
    gone, before = set(), set()
    for step in range(1, now.steps + 1):
        speed_mps = min(max(ego.speed_mps + asked[(step - 1) // 10] * 0.1, 0.0), 25.0)
        ego = at(ego, ego.x_m + ego.speed_mps * 0.1, speed_mps)
        there = traffic.advance(step, ego).keys()
        assert there
        gone |= before - there
        assert not gone & there
        before = set(there)
    assert gone


def test_an_undisturbed_drive_loses_the_tracks_of_cars_that_go():
    """Of the six losses that docs/world.md tells of, four are of cars that have gone."""
    planner = plugins.load(plugins.PLANNERS, "rulebook")(RulebookSettings())
    simulation = PointMassSimulator().open(HighwayDrive(), HighwayDriveParameters(), planner, ())
    seen = simulation.reset(0)
    speeds, there, losses = [seen.ego.speed_mps], [set(seen.ids)], [0.0]
    while not seen.ended:
        seen = simulation.step(())
        speeds.append(seen.ego.speed_mps)
        there.append(set(seen.ids))
        losses.append(planner.signals()["lost_tracks"])
    assert not seen.collided
    assert losses[-1] == 6.0
    last = {number: max(find_steps(there, number)) for number in range(1, 5)}
    lost = [step for step in range(1, len(losses)) if losses[step] > losses[step - 1]]
    # The eighth miss is of the eighth moment without the car, from which the next step is planned.
    gone = {last[number] + 9 for number in (PASSING, FOLLOWING, LEADING, SLOW)}
    assert set(lost) - gone == {110, 188}
    assert (min(find_steps(there, SLOW)), last[FOLLOWING]) == (100, 144)
    assert speeds[CUT_IN_STEP] == pytest.approx(16.9, abs=0.05)


def find_steps(there, number):
    """The steps after which a vehicle is there."""
    return [step for step, numbers in enumerate(there) if number in numbers]


def test_every_episode_has_traffic_of_its_own():
    now = situation()
    drive(now, 20.0)
    assert drive(now) == drive(now)


class Driver:
    """Keeps its speed, and brakes where it is told to; or for a car ahead in its own lane."""

    def __init__(self, brakes_at_s=99.0, looks_ahead=False, losses=None):
        self.brakes_at_s, self.looks_ahead = brakes_at_s, looks_ahead
        if losses is not None:
            self.count_losses = lambda vehicle: losses.get(vehicle, 0)

    def reset(self, mission):
        pass

    def act(self, perception):
        ego = perception.ego
        ahead = [
            other.speed_mps - ego.speed_mps
            for other in perception.others
            if abs(other.y_m) < 1.0 and 0.0 < other.x_m - ego.x_m < 60.0
        ]
        if self.looks_ahead and ahead and min(ahead) < 0.0:
            return Control(-4.0, 0.0)
        return Control(-7.0 if perception.time_s >= self.brakes_at_s else 0.0, 0.0)


def find_cause(driver):
    simulation = PointMassSimulator().open(HighwayDrive(), HighwayDriveParameters(), driver, ())
    seen = simulation.reset(0)
    while not seen.ended:
        assert seen.cause is None
        seen = simulation.step(())
    return seen.cause


def test_the_cause_is_the_challenge_of_the_vehicle_struck():
    assert find_cause(Driver(brakes_at_s=4.0)) == "phantom"
    assert find_cause(Driver()) == "reveal"
    assert find_cause(Driver(looks_ahead=True)) == "cut-in"


def test_a_planner_with_tracks_tells_whether_it_lost_the_one_that_was_struck():
    assert find_cause(Driver(losses={SLOW: 2})) == "reveal, track lost"
    assert find_cause(Driver(losses={LEADING: 1})) == "reveal, track kept"


def test_rulebook_fails_by_a_phantom_where_noise_pulls_the_passing_car_inward():
    """Its lateral position alone is wrong, and one car alone: the follower runs into the truck."""
    model = DisturbanceModel(channels=(Channel("vehicle_1.lateral"),))
    z = np.zeros((420, 1), np.float32)
    z[30:60] = -3.0
    setup = EpisodeSetup("point_mass", "highway_drive", {}, "rulebook", {}, model, 1)
    (result,) = Engine(setup).run([EpisodeTask(0, 0, TrajectorySource(z))])
    assert result.measures.cause == "phantom, track kept"
    assert result.scene.vehicles.shape == (result.steps + 1, 3, 4)
    (again,) = Engine(setup).run([EpisodeTask(0, 0, TrajectorySource(result.noise.z))])
    assert again.digest() == result.digest()


def test_noise_of_every_vehicle_is_of_the_five():
    channels = (Channel("every.longitudinal"), Channel("ghost"), Channel("every.missed"))
    setup = EpisodeSetup(
        *("point_mass", "highway_drive", {}, "idm", {}, DisturbanceModel(channels=channels))
    )
    (result,) = Engine(setup).run([EpisodeTask(0, 0, TrajectorySource(np.zeros((0, 11))))])
    assert result.fault is None
    assert result.noise.z.shape == (420, 11)
    assert result.measures.cause is None
