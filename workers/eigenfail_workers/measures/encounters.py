"""The ego and other vehicles, at a moment and between two: conflicts, near passes and contacts.

Surrogate safety measures have the definitions of FHWA-RD-03-050 (Surrogate Safety Measures from
Traffic Simulation Models), extended from one lane to the plane. The gap is the distance between the
footprints. The closing speed is the relative velocity along the line of nearest points.

Between two samples, a footprint is assumed to turn at a constant rate, the short way. It moves on
the arc of a vehicle that turns at this rate, or on a straight line if it does not turn. Without
this motion, a vehicle that crosses the ego within one step would never be seen to touch it.
"""

from collections.abc import Sequence
from math import ceil, hypot, pi, remainder
from typing import Final, NamedTuple

from msgspec.structs import replace

from eigenfail.errors import InvalidValue, SimulatorError
from eigenfail.values.scene import Observation, VehicleState
from eigenfail_workers.measures import geometry
from eigenfail_workers.values import Separation, TrafficConflict

LOOK_AHEAD_S: Final = 1.0
"""A vehicle enters the path if its footprint will overlap the ego's laterally within this time."""

LONGEST_STEP_S: Final = 0.1
"""Conflicts are judged at moments no further apart than this; it is the step of the built-in
scenarios."""

HIDDEN_M: Final = 1e-3
"""A distance between two samples counts if it is smaller than both of theirs by more than this, so
that rounding changes nothing."""

TURN_RAD: Final = 0.02
"""While footprints turn by no more than this, their distance is as good as convex in time."""

LEAST_BEND_M: Final = 0.01
"""An arc that is nearer to its chord than this is taken as the chord. In the steps of the built-in
scenarios all are."""

GRIP_MPS2: Final = 10.0
"""No tyre turns a vehicle with more: such a heading is a fault of a tracker, not an arc."""

PRECISION_M: Final = 1e-5
MOST_TURNS: Final = 100
GOLDEN: Final = 0.6180339887498949

JUMP_M: Final = 1.0
"""A way in one step that is longer than twice the speed allows, by more than this, is a jump."""

REACH_M: Final = 1.0
"""A reported contact may leave so much room between rectangles, which are rounder in a simulator's
own test, beside what two vehicles that bounce apart move within the step."""

CLAIM = "`collided` means that the ego touches another vehicle that is shown."


def find_conflict(
    ego: VehicleState, other: VehicleState, between: Separation
) -> TrafficConflict | None:
    """Return the conflict of the ego with another vehicle, or None.

    A conflict exists while the gap is positive and shrinks, and the vehicle is in the ego's path or
    entering it. A contact is not a conflict, because DRAC tends to infinity there. The largest DRAC
    is therefore the value at the last moment before the contact.
    """
    if between.distance_m == 0.0 or not shares_path(ego, other):
        return None
    vx, vy = geometry.velocity(ego)
    other_vx, other_vy = geometry.velocity(other)
    nx, ny = between.direction
    closing = (vx - other_vx) * nx + (vy - other_vy) * ny
    if closing <= 0.0:
        return None
    return TrafficConflict(between.distance_m / closing, closing**2 / (2.0 * between.distance_m))


def shares_path(ego: VehicleState, other: VehicleState) -> bool:
    """Return whether the footprints overlap laterally, now or within LOOK_AHEAD_S.

    Lateral means across the road; the lateral velocities are assumed constant.
    """
    offset = other.y_m - ego.y_m
    gap = (
        abs(offset) - geometry.half_width_across_road(ego) - geometry.half_width_across_road(other)
    )
    drift = geometry.velocity(other)[1] - geometry.velocity(ego)[1]
    approach = -drift if offset > 0.0 else drift
    return gap <= max(approach, 0.0) * LOOK_AHEAD_S


class Pair(NamedTuple):
    """The ego and another vehicle at one moment."""

    ego: VehicleState
    other: VehicleState


class Pass(NamedTuple):
    """The smallest distance between two samples.

    Attributes:
        share: moment of the smallest distance, as a share of the step.
        distance_m: distance of the footprints; 0 if they touch or overlap.
    """

    share: float
    distance_m: float


def move(before: VehicleState, after: VehicleState, share: float) -> VehicleState:
    """Return a vehicle within a step.

    A footprint is the same after half a turn. So a heading that is reversed within a step, as
    trackers do by mistake, does not turn the footprint.

    Args:
        before: state at the previous sample.
        after: state at the next sample.
        share: part of the step that is over, in [0, 1].
    """
    turn_rad = remainder(after.heading_rad - before.heading_rad, pi)
    # From the nearer sample, so that at both ends the heading is exactly that of the sample, also
    # if the tracker has turned the vehicle round in between.
    if share < 0.5:
        heading_rad = before.heading_rad + share * turn_rad
    else:
        heading_rad = after.heading_rad - (1.0 - share) * turn_rad
    dx, dy = after.x_m - before.x_m, after.y_m - before.y_m
    bend = 4.0 * share * (1.0 - share) * _find_bend(before, after)
    return VehicleState(
        before.x_m + share * dx + bend * dy,
        before.y_m + share * dy - bend * dx,
        heading_rad,
        before.speed_mps + share * (after.speed_mps - before.speed_mps),
        after.length_m,
        after.width_m,
    )


def _find_bend(before: VehicleState, after: VehicleState) -> float:
    """Return how far a vehicle's way bends from its chord, as a share of the chord's length.

    An arc that turns left lies to the right of its chord, forwards and in reverse. Its height is
    about a chord times an eighth of its angle.
    """
    if before.heading_rad == after.heading_rad:
        return 0.0
    turn_rad = remainder(after.heading_rad - before.heading_rad, pi)
    way_m = hypot(after.x_m - before.x_m, after.y_m - before.y_m)
    speed_mps = 0.5 * (before.speed_mps + after.speed_mps)
    is_chord = 0.125 * way_m * abs(turn_rad) < LEAST_BEND_M
    if is_chord or speed_mps**2 * abs(turn_rad) > GRIP_MPS2 * way_m:
        return 0.0
    return 0.125 * turn_rad


def find_pass(
    before: Pair, after: Pair, apart_before: Separation, apart_after: Separation
) -> Pass | None:
    """Return the smallest distance within a step, if both samples hide it; None otherwise.

    The search runs only if the motion can hide more than HIDDEN_M. The distance of two convex
    shapes is convex in time while they do not turn: the tangents at both samples bound it from
    below. Turning lowers that bound by at most the half-diagonals times the angles, and an arc
    lowers it by at most four times its height.

    Args:
        before: the two vehicles at the previous sample.
        after: the two vehicles at the next sample.
        apart_before: their separation at the previous sample.
        apart_after: their separation at the next sample.
    """
    ego, other, ego_after, other_after = before.ego, before.other, after.ego, after.other
    dx = (other_after.x_m - other.x_m) - (ego_after.x_m - ego.x_m)
    dy = (other_after.y_m - other.y_m) - (ego_after.y_m - ego.y_m)
    first_m, last_m = apart_before.distance_m, apart_after.distance_m
    begin = dx * apart_before.direction[0] + dy * apart_before.direction[1]
    end = dx * apart_after.direction[0] + dy * apart_after.direction[1]
    turned_m = _bound_turn(ego, ego_after) + _bound_turn(other, other_after)
    begin, end = begin - turned_m, end + turned_m
    if begin >= 0.0 or end <= 0.0 or first_m == 0.0 or last_m == 0.0:
        return None
    least_m = min(first_m, last_m)
    # Both tangents lie below the distance; the larger of the two is least where they cross.
    crossing = (last_m - end - first_m) / (begin - end)
    if first_m + begin * crossing >= least_m - HIDDEN_M:
        return None
    return _search_step(before, after, least_m)


def _bound_turn(before: VehicleState, after: VehicleState) -> float:
    """Return an upper bound of how fast a turn takes a corner of a footprint off a straight way.

    In metres for a whole step. Half of length and width together is more than the half-diagonal.
    """
    turn_rad = after.heading_rad - before.heading_rad
    if turn_rad == 0.0:
        return 0.0
    turned_m = 0.5 * abs(remainder(turn_rad, pi)) * (before.length_m + before.width_m)
    return turned_m + 4.0 * _bound_bend(before, after)


def _bound_bend(before: VehicleState, after: VehicleState) -> float:
    """Return an upper bound of how far an arc is from its chord. [m]"""
    way_m = abs(after.x_m - before.x_m) + abs(after.y_m - before.y_m)
    return abs(_find_bend(before, after)) * way_m


def _search_step(before: Pair, after: Pair, least_m: float) -> Pass | None:
    """Return the smallest distance within a step, if it is below the distance at both samples.

    Args:
        before: the two vehicles at the previous sample.
        after: the two vehicles at the next sample.
        least_m: smaller of the distances at the two samples.
    """
    turns_rad = [
        abs(remainder(late.heading_rad - early.heading_rad, pi))
        for early, late in ((before.ego, after.ego), (before.other, after.other))
    ]
    pieces = 1 + int(sum(turns_rad) / TURN_RAD)
    precision = PRECISION_M / _bound_way(before, after)
    found = min(
        [_search(before, after, piece / pieces, 1.0 / pieces, precision) for piece in range(pieces)]
    )
    return Pass(found[1], found[0]) if found[0] < least_m - HIDDEN_M else None


def _search(
    before: Pair, after: Pair, begin: float, length: float, precision: float
) -> tuple[float, float]:
    """Return the smallest distance in a part of a step [m], and its share of the step.

    Golden-section search; it ends at the first contact that it meets.
    """
    one, two = begin + (1.0 - GOLDEN) * length, begin + GOLDEN * length
    one_m, two_m = _measure(before, after, one), _measure(before, after, two)
    for _ in range(MOST_TURNS):
        if one_m == 0.0 or two_m == 0.0 or length < precision:
            break
        length *= GOLDEN
        if one_m <= two_m:
            two, two_m = one, one_m
            one = begin + (1.0 - GOLDEN) * length
            one_m = _measure(before, after, one)
        else:
            begin = one
            one, one_m = two, two_m
            two = begin + GOLDEN * length
            two_m = _measure(before, after, two)
    return (one_m, one) if one_m <= two_m else (two_m, two)


def _measure(before: Pair, after: Pair, share: float) -> float:
    """Return the distance of the footprints within a step. [m]"""
    ego = move(before.ego, after.ego, share)
    return geometry.separation(ego, move(before.other, after.other, share)).distance_m


def _find_touch(before: Pair, after: Pair, contact: float) -> float:
    """Return the share of the step at which two footprints first touch, given one at which they do.

    By bisection. The footprints touch at the returned share: their separation there is exactly 0.
    """
    apart, touching = 0.0, contact
    for _ in range(MOST_TURNS):
        middle = 0.5 * (apart + touching)
        # No number is left between the two.
        if middle <= apart or middle >= touching:
            break
        if _measure(before, after, middle) == 0.0:
            touching = middle
        else:
            apart = middle
    return touching


class TrafficSample(NamedTuple):
    """All vehicles at one moment.

    Attributes:
        ego: the ego.
        others: every other vehicle that is there.
        numbers: number of each of them.
    """

    ego: VehicleState
    others: tuple[VehicleState, ...]
    numbers: Sequence[int]

    def by_number(self) -> dict[int, VehicleState]:
        """Return the vehicles except the ego, by number."""
        return dict(zip(self.numbers, self.others, strict=True))


def may_touch(before: TrafficSample, after: TrafficSample) -> bool:
    """Return whether the ego may touch a vehicle within a step, or at its end.

    This test rules out most steps, with a few sums for each vehicle.
    """
    if before.numbers != after.numbers:
        return True
    ego, was = after.ego, before.ego
    ego_x, ego_y = ego.x_m - was.x_m, ego.y_m - was.y_m
    bend_m = _bound_bend(was, ego)
    for place in range(len(after.others)):
        other, other_was = after.others[place], before.others[place]
        # Half of length and width together is more than the half-diagonal, and needs no root. This
        # test runs for every vehicle in every step.
        reach = 0.5 * (ego.length_m + ego.width_m + other.length_m + other.width_m)
        reach += bend_m + _bound_bend(other_was, other)
        reach += abs(other.x_m - other_was.x_m - ego_x) + abs(other.y_m - other_was.y_m - ego_y)
        if abs(other.x_m - ego.x_m) <= reach and abs(other.y_m - ego.y_m) <= reach:
            return True
    return False


def find_contact(
    before: TrafficSample, after: TrafficSample, dt_s: float, is_reported: bool = False
) -> TrafficSample | None:
    """Return the moment within a step at which the ego first touches a vehicle.

    Args:
        before: the vehicles at the previous sample.
        after: the vehicles at the next sample.
        dt_s: duration of the step.
        is_reported: whether the simulator reports a collision. Some simulators remove the struck
            vehicle at once: it is then placed at the point of contact.

    Returns:
        None if the ego touches no vehicle, or if the sample shows the first vehicle that it
        touches.

    Raises:
        SimulatorError: a vehicle jumps across the ego, or vanishes in front of it without a
            collision, so that a collision can be neither confirmed nor ruled out.
    """
    known, shown_after = before.by_number(), after.by_number()
    vanished = _find_vanished(before, after, dt_s)
    if vanished and not is_reported:
        raise SimulatorError(
            f"Vehicle {min(vanished)} vanishes where the ego would have touched it.",
            "Show a vehicle until the ego cannot touch it, and report collisions.",
        )
    hidden: list[float] = []
    shown: list[float] = []
    there = {**shown_after, **vanished}
    for number, other in there.items():
        was = known.get(number)
        if was is None:
            continue
        start, end = Pair(before.ego, was), Pair(after.ego, other)
        share = _find_contact_share(start, end)
        if share is None:
            continue
        if share == 1.0 and number in shown_after:
            shown.append(_find_touch(start, end, share))
        else:
            # A vehicle that is put elsewhere "touches" all that lies between, without having been
            # there.
            _check_way(number, was, other, dt_s)
            _check_way(0, before.ego, after.ego, dt_s)
            hidden.append(_find_touch(start, end, share))
    # The ego has hit a vehicle that the sample shows, before it would have met one within the step:
    # the sample itself is the contact.
    if not hidden or (shown and min(hidden) >= min(shown)):
        return None
    first = min(hidden)
    others = [
        move(known[number], other, first) if number in known else other
        for number, other in there.items()
    ]
    return TrafficSample(move(before.ego, after.ego, first), tuple(others), tuple(there))


def _find_vanished(
    before: TrafficSample, after: TrafficSample, dt_s: float
) -> dict[int, VehicleState]:
    """Return the vanished vehicles that the ego would have touched, by number.

    Their positions at the next sample are extrapolated at constant velocity.
    """
    found = {}
    shown = after.by_number()
    for number, gone in before.by_number().items():
        if number in shown:
            continue
        vx, vy = geometry.velocity(gone)
        later = replace(gone, x_m=gone.x_m + vx * dt_s, y_m=gone.y_m + vy * dt_s)
        if _find_contact_share(Pair(before.ego, gone), Pair(after.ego, later)) is not None:
            found[number] = later
    return found


def _bound_way(before: Pair, after: Pair) -> float:
    """Return an upper bound of the relative motion of two footprints within a step. [m]"""
    dx = (after.other.x_m - before.other.x_m) - (after.ego.x_m - before.ego.x_m)
    dy = (after.other.y_m - before.other.y_m) - (after.ego.y_m - before.ego.y_m)
    turned_m = _bound_turn(before.ego, after.ego) + _bound_turn(before.other, after.other)
    return hypot(dx, dy) + turned_m


def _find_contact_share(before: Pair, after: Pair) -> float | None:
    """Return a share of the step at which two footprints touch: 1 if they do at its end."""
    way_m = _bound_way(before, after)
    if geometry.distance_lower_bound(after.ego, after.other) > way_m:
        return None
    apart = geometry.separation(after.ego, after.other)
    if apart.distance_m == 0.0:
        return 1.0
    if apart.distance_m > way_m:
        return None
    passed = find_pass(before, after, geometry.separation(before.ego, before.other), apart)
    return passed.share if passed is not None and passed.distance_m == 0.0 else None


def _check_way(number: int, before: VehicleState, after: VehicleState, dt_s: float) -> None:
    way_m = hypot(after.x_m - before.x_m, after.y_m - before.y_m)
    speed_mps = max(abs(before.speed_mps), abs(after.speed_mps))
    if way_m > 2.0 * speed_mps * dt_s + JUMP_M:
        who = f"Vehicle {number} jumps across the ego" if number else "The ego jumps"
        raise SimulatorError(
            f"{who}: {way_m:.3g} m in a step of {dt_s:g} s, at {speed_mps:.3g} m/s.",
            "Show every vehicle in its place (with `ids` if vehicles come and go), at its speed.",
        )


def end_at_contact(before: Observation | None, now: Observation, dt_s: float) -> Observation:
    """Return an observation with the collision that its footprints show.

    A contact at the sample ends the episode there. For a contact between the samples, the vehicles
    are placed at their positions at the ego's first contact. So an unreported collision is never
    taken for safe, and states after a contact are not judged.

    Args:
        before: previous observation; None at the start.
        now: the observation.
        dt_s: duration of a step.

    Raises:
        InvalidValue: the episode starts in a collision.
        SimulatorError: the footprints rule out a reported collision, or do not show whether there
            is a collision.
    """
    if before is not None:
        earlier, later = make_sample(before), make_sample(now)
        if not (now.collided or may_touch(earlier, later)):
            return now
        contact = find_contact(earlier, later, dt_s, now.collided)
        if contact is not None:
            return replace(
                now,
                ego=contact.ego,
                others=contact.others,
                collided=True,
                ended=True,
                ids=None if now.ids is None else tuple(contact.numbers),
            )
    touches = any(touch(now.ego, other) for other in now.others)
    if before is None and (touches or now.collided):
        raise make_start_error()
    if now.collided and not touches:
        # Some simulators test rounder shapes than rectangles: near enough is believed.
        _check_reported(before or now, now, dt_s)
    if touches or now.collided:
        return now if now.collided and now.ended else replace(now, collided=True, ended=True)
    return now


def make_start_error() -> InvalidValue:
    """Return the error of an episode that starts in a collision."""
    return InvalidValue(
        "scenario_parameters", "the ego starts in a collision.", "Start it further away."
    )


def make_sample(seen: Observation) -> TrafficSample:
    """Return the vehicles of an observation."""
    return TrafficSample(seen.ego, seen.others, seen.numbers)


def touch(ego: VehicleState, other: VehicleState) -> bool:
    """Return whether two footprints touch or overlap."""
    return (
        geometry.distance_lower_bound(ego, other) <= 0.0
        and geometry.separation(ego, other).distance_m == 0.0
    )


def _check_reported(before: Observation, now: Observation, dt_s: float) -> None:
    """Check that a vehicle is near enough for a reported collision without an overlap."""
    if not now.others:
        problem = f"After step {now.step} a collision is reported, and there is no other vehicle."
        raise SimulatorError(problem, f"{CLAIM} Show what was hit, or report it as a signal.")
    known = make_sample(before).by_number()
    nearest_m, nearest = min(
        [
            (geometry.separation(now.ego, other).distance_m, number)
            for number, other in zip(now.numbers, now.others, strict=True)
        ]
    )
    other = make_sample(now).by_number()[nearest]
    was = known.get(nearest, other)
    closing_mps = max(_measure_speed(before.ego, was), _measure_speed(now.ego, other))
    if nearest_m > REACH_M + closing_mps * dt_s:
        raise SimulatorError(
            f"After step {now.step} a collision is reported, and the nearest vehicle, {nearest}, "
            f"is {nearest_m:.3g} m away.",
            f"{CLAIM} Show what was hit, or report it as a signal.",
        )


def _measure_speed(ego: VehicleState, other: VehicleState) -> float:
    """Return the relative speed of two vehicles. [m/s]"""
    vx, vy = geometry.velocity(ego)
    other_vx, other_vy = geometry.velocity(other)
    return hypot(other_vx - vx, other_vy - vy)


def list_conflicts(before: Pair, after: Pair, dt_s: float) -> list[TrafficConflict]:
    """Return the conflicts within a step, at moments no further apart than LONGEST_STEP_S."""
    # The tolerance is for rounding: three steps of 0.1 s are 0.30000000000000004 s, and need no
    # fourth part.
    parts = ceil(dt_s / LONGEST_STEP_S - 1e-9)
    found = []
    for part in range(1, parts):
        ego = move(before.ego, after.ego, part / parts)
        other = move(before.other, after.other, part / parts)
        conflict = find_conflict(ego, other, geometry.separation(ego, other))
        if conflict is not None:
            found.append(conflict)
    return found
