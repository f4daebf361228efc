"""Recorded traffic: as recorded while the ego keeps to its place, and reactive once it does not."""

from itertools import pairwise
from math import hypot

import numpy as np
import pytest
from msgspec.structs import replace

from eigenfail.contracts import ReactiveSituation
from eigenfail.errors import InvalidValue
from eigenfail.testing.scenario import SCENARIO_CHECKS
from eigenfail_exchange.recorded_traffic import scenario
from eigenfail_exchange.recorded_traffic.tracks import RecordedTracks

DT_S = 0.1


def make_tracks(*vehicles, seconds=20.0):
    """Tracks of vehicles at constant speed along x, each of x [m], y [m] and speed [m/s]."""
    time_s = np.arange(round(seconds / DT_S) + 1) * DT_S
    states = np.zeros((len(time_s), len(vehicles), 4))
    for number, (x_m, y_m, speed) in enumerate(vehicles):
        states[:, number, 0], states[:, number, 1] = x_m + speed * time_s, y_m
        states[:, number, 3] = speed
    sizes = np.array([[16.0, 2.5], *[[5.0, 2.0]] * (len(vehicles) - 1)])
    return RecordedTracks(DT_S, tuple(map(str, range(len(vehicles)))), states, sizes)


def stage(tracks, reactive_from_m=5.0):
    class Recording(scenario.RecordedTraffic):
        pass

    Recording.tracks = tracks
    return Recording()(scenario.RecordedTrafficParameters(reactive_from_m), 0)


def play(situation, speeds, y_m=0.0):
    """The states of all vehicles at each step, for an ego at these speeds."""
    ego, seen = situation.ego, [(situation.ego, *situation.actors)]
    for step, speed in enumerate(speeds, start=1):
        ego = replace(ego, x_m=ego.x_m + speed * DT_S, speed_mps=speed, y_m=y_m)
        actors = range(len(situation.actors))
        seen.append((ego, *(situation.move_actor(actor, step, ego) for actor in actors)))
    return seen


def gap(rear, front):
    return front.x_m - rear.x_m - 0.5 * (front.length_m + rear.length_m)


ALONG = make_tracks((0.0, 0.0, 20.0), (-40.0, 0.0, 20.0), (10.0, 3.5, 25.0))


def test_others_replay_the_recording_while_the_ego_keeps_its_place():
    situation = stage(ALONG)
    for step, states in enumerate(play(situation, [20.2] * situation.steps)):
        for number, state in enumerate(states[1:], start=1):
            found = (state.x_m, state.y_m, state.heading_rad, state.speed_mps)
            assert found == tuple(ALONG.states[step, number])


def test_others_react_once_the_ego_is_further_away_than_the_distance():
    situation = stage(ALONG)
    # At 2 m/s less, the ego is 5 m behind its place after 2.5 s, and then further.
    seen = play(situation, [18.0] * situation.steps)
    recorded = [states[1].x_m == ALONG.states[step, 1, 0] for step, states in enumerate(seen)]
    assert all(recorded[:25])
    assert not any(recorded[27:])


def test_a_larger_distance_keeps_the_recording():
    situation = stage(ALONG, reactive_from_m=1000.0)
    seen = play(situation, [0.0] * situation.steps)
    assert seen[-1][1].x_m == pytest.approx(ALONG.states[-1, 1, 0])


def test_the_vehicle_behind_stops_for_an_ego_that_stops():
    situation = stage(ALONG)
    speeds = np.maximum(20.0 - 3.0 * DT_S * np.arange(situation.steps), 0.0)
    seen = play(situation, speeds)
    gaps = [gap(states[1], states[0]) for states in seen]
    assert min(gaps) > 0.5 * scenario.STANDSTILL_GAP_M
    assert seen[-1][1].speed_mps < 0.5
    assert all(before[1].x_m <= after[1].x_m for before, after in pairwise(seen))


def test_a_follower_keeps_the_gap_of_the_model():
    # The gap at which the model neither accelerates nor brakes:
    # s_e(v) = (s0 + v T) / sqrt(1 - (v / v0)^4).
    desired, speed = 20.0, 15.0
    situation = stage(make_tracks((0.0, 0.0, desired), (-60.0, 0.0, desired), seconds=200.0))
    ego, follower = play(situation, [speed] * situation.steps)[-1]
    wanted = (scenario.STANDSTILL_GAP_M + speed * scenario.TIME_GAP_S) / (
        1.0 - (speed / desired) ** 4
    ) ** 0.5
    assert follower.speed_mps == pytest.approx(speed, abs=0.01)
    # Its law sees the ego a step later than itself.
    assert gap(follower, ego) == pytest.approx(wanted, abs=2 * speed * DT_S)


def test_a_follower_that_was_too_near_falls_back_without_an_emergency():
    # 10 m behind at 20 m/s, half a second: people drive so, and the model wants 34 m.
    situation = stage(make_tracks((0.0, 0.0, 20.0), (-20.5, 0.0, 20.0)), reactive_from_m=1.0)
    seen = play(situation, [19.5] * situation.steps)
    speeds = [states[1].speed_mps for states in seen]
    hardest = max(before - after for before, after in pairwise(speeds)) / DT_S
    assert 0.5 < hardest < 1.2 * scenario.DECELERATION_MPS2
    assert gap(seen[-1][1], seen[-1][0]) > 19.5 * scenario.TIME_GAP_S
    assert min(gap(states[1], states[0]) for states in seen) > 0.5 * 10.0


def test_vehicles_in_other_lanes_are_not_braked_for():
    situation = stage(ALONG)
    seen = play(situation, [10.0] * situation.steps)
    assert seen[-1][2].speed_mps == pytest.approx(25.0, abs=0.01)
    assert seen[-1][2].y_m == 3.5


def test_parked_vehicles_stay_where_they_are():
    parked = (200.0, 3.5, 0.0), (-30.0, 3.5, 0.05)
    situation = stage(make_tracks((0.0, 0.0, 20.0), *parked))
    seen = play(situation, [10.0] * situation.steps)
    assert seen[-1][1] == seen[0][1]
    # Positions of a standing vehicle drift in a recording; it stays where reacting began.
    assert seen[-1][2] == seen[100][2]


@pytest.mark.parametrize(
    ("speed", "words"), [(0.0, "stands all the time"), (-20.0, "does not end ahead")]
)
def test_an_ego_without_a_way_ahead_is_refused(speed, words):
    tracks = make_tracks((0.0, 0.0, speed), (50.0, 0.0, 20.0))
    tracks.states[:, 0, 3] = abs(speed)
    with pytest.raises(InvalidValue, match=words):
        stage(tracks)


def test_vehicles_that_react_stay_on_their_paths():
    tracks = make_tracks((0.0, 0.0, 20.0), (-40.0, 0.0, 20.0))
    course = tracks.states[:, 1]
    course[:, 1] = 3.5 * np.clip((course[:, 0] - 50.0) / 100.0, 0.0, 1.0)
    course[:, 2] = np.arctan2(np.gradient(course[:, 1]), np.gradient(course[:, 0]))
    seen = play(stage(tracks), [15.0] * (len(tracks.states) - 1))
    for states in seen:
        state = states[1]
        assert state.y_m == pytest.approx(3.5 * np.clip((state.x_m - 50.0) / 100.0, 0, 1), abs=0.02)
    for before, after in pairwise(seen):
        way = hypot(after[1].x_m - before[1].x_m, after[1].y_m - before[1].y_m)
        assert way == pytest.approx(
            0.5 * (before[1].speed_mps + after[1].speed_mps) * DT_S, abs=0.05
        )


def test_each_episode_of_a_situation_begins_anew():
    situation = stage(ALONG)
    slow = play(situation, [10.0] * situation.steps)
    kept = play(situation, [20.0] * situation.steps)
    assert kept[-1][1].x_m == ALONG.states[-1, 1, 0]
    assert play(situation, [10.0] * situation.steps) == slow


@pytest.mark.parametrize(("distance_m", "valid_s"), [(0.95, 1.0), (4.95, 5.0), (1000.0, 20.0)])
def test_a_recording_is_valid_until_the_ego_has_left_it(distance_m, valid_s):
    course = ALONG.states[:, 0].astype(np.float32)
    course[:, 0] += np.arange(len(course)) * DT_S
    assert scenario.find_log_validity(ALONG, course, distance_m) == pytest.approx(valid_s)
    short = course[:3]
    assert scenario.find_log_validity(ALONG, short, distance_m) == pytest.approx(min(valid_s, 0.2))


def test_a_recording_is_not_valid_where_the_ego_has_no_place():
    course = ALONG.states[:, 0].copy()
    course[30:, :2] = np.nan
    assert scenario.find_log_validity(ALONG, course, 1.0) == pytest.approx(3.0)


def mask(tracks, number, first, last):
    """The tracks, with a vehicle that is there from one step to another."""
    steps = np.arange(len(tracks.states))
    tracks.states[(steps < first) | (steps > last), number] = np.nan
    return tracks


def make_changing():
    """The ego, a car behind it all the time, one that goes, and one that comes and goes."""
    tracks = make_tracks((0, 0, 20.0), (-40, 0, 20.0), (10, 3.5, 25.0), (60, 3.5, 18.0))
    return mask(mask(tracks, 2, 0, 80), 3, 50, 150)


def play_traffic(situation, speeds):
    """The vehicles at each step by number, for an ego at these speeds."""
    traffic, ego = situation.start_traffic(), situation.ego
    seen = [dict(enumerate(situation.actors, 1))]
    for step, speed in enumerate(speeds, start=1):
        ego = replace(ego, x_m=ego.x_m + speed * DT_S, speed_mps=speed)
        seen.append(dict(traffic.advance(step, ego)))
    return seen


@pytest.mark.parametrize("check", SCENARIO_CHECKS)
def test_vehicles_that_come_and_go_fulfil_the_contract(check):
    class Recording(scenario.RecordedTraffic):
        tracks = make_changing()

    check(Recording())


def test_vehicles_come_and_go_as_recorded_while_the_ego_keeps_its_place():
    tracks = make_changing()
    situation = stage(tracks)
    assert isinstance(situation, ReactiveSituation)
    assert situation.challenges == ("vehicle 1", "vehicle 2", "vehicle 3")
    assert len(situation.actors) == 2
    for step, there in enumerate(play_traffic(situation, [20.0] * situation.steps)):
        recorded = np.flatnonzero(np.isfinite(tracks.states[step, :, 0]))[1:]
        assert list(there) == recorded.tolist()
        for number, state in there.items():
            assert state.x_m == tracks.states[step, number, 0]


def test_vehicles_that_react_come_and_go():
    situation = stage(make_changing())
    seen = play_traffic(situation, [17.0] * situation.steps)
    assert next(step for step, there in enumerate(seen) if 3 in there) == 50
    assert 2 in seen[70]
    # Each goes once it is beyond the end of its recorded path.
    assert 2 not in seen[-1]
    assert 3 not in seen[-1]
    last = max(step for step, there in enumerate(seen) if 3 in there)
    assert seen[last][3].x_m == pytest.approx(60.0 + 18.0 * 15.0, abs=3.0)


def test_a_vehicle_comes_only_where_there_is_room():
    tracks = mask(make_tracks((0, 0, 20.0), (-40, 0, 20.0), (-20, 0, 20.0)), 2, 50, 200)
    situation = stage(tracks)
    # An ego at 16 m/s is where the second vehicle would come, at x = 80 m after 5 s.
    seen = play_traffic(situation, [16.0] * situation.steps)
    assert all(2 not in there for there in seen[:60])
    for step, there in enumerate(seen):
        ego = replace(situation.ego, x_m=16.0 * DT_S * step)
        assert all(abs(each.x_m - ego.x_m) > 5.0 for each in there.values())


def test_the_last_vehicle_stays():
    tracks = make_tracks((0, 0, 20.0), (30, 3.5, 25.0), (-50, 0, 5.0))
    situation = stage(mask(mask(tracks, 1, 0, 100), 2, 101, 200))
    # The ego is where the second one would come, and the first one is beyond the end of its path.
    seen = play_traffic(situation, [0.05] * situation.steps)
    assert all(seen)
    assert list(seen[105]) == [1]
