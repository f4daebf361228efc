"""Conformance suite of `Scenario`.

@pytest.mark.parametrize("check", SCENARIO_CHECKS)
def test_my_scenario(check):
    check(MyScenario())
"""

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from math import cos, hypot, isfinite, sin

import msgspec

from eigenfail.contracts import ReactiveSituation, Scenario, Situation
from eigenfail.settings import read_settings
from eigenfail.testing import expect
from eigenfail.values.scene import VehicleState

AnySituation = Situation | ReactiveSituation

# The last one does not fit into 32 bits, as real seeds do not.
SEEDS = (0, 1, 2**62)
MOST_LISTED = 20
TOLERANCE_M = 0.05
"""Tolerance of an actor's way in one step against its reported speed × dt."""


def has_valid_defaults(scenario: Scenario) -> None:
    """Every parameter has a default within its bounds, and survives conversion to plain data."""
    parameters = read_settings(scenario.Parameters, {}, "scenario_parameters")
    plain = msgspec.to_builtins(parameters)
    again = read_settings(scenario.Parameters, plain, "scenario_parameters")
    expect(again == parameters, "The default parameters change on their way through plain data.")


def is_plausible(scenario: Scenario) -> None:
    """A situation has time, a road, a task and at least one actor."""
    for situation in _situations(scenario):
        mission = situation.mission
        expect(mission.dt_s > 0.0 and situation.steps >= 1, "The episode has no duration.")
        expect(mission.lanes >= 1 and mission.lane_width_m > 0.0, "The road has no lane.")
        expect(len(situation.actors) >= 1, "There is no vehicle beside the ego.")
        if isinstance(situation, ReactiveSituation):
            named = len(situation.challenges) >= len(situation.actors)
            expect(named, "There are more vehicles than `challenges` names.")
        for vehicle in (situation.ego, *situation.actors):
            # A sum with NaN or infinity in it is not finite.
            is_finite = isfinite(sum(msgspec.structs.astuple(vehicle)))
            expect(is_finite, f"{vehicle} is not made of finite numbers.")
            expect(min(vehicle.length_m, vehicle.width_m) > 0.0, f"{vehicle} has no footprint.")


def starts_without_overlap(scenario: Scenario) -> None:
    """The ego touches no vehicle at the start, or when the vehicle first appears."""
    for situation in _situations(scenario):
        for actor in situation.actors:
            expect(are_apart(situation.ego, actor), f"At the start the ego overlaps {actor}.")
        if isinstance(situation, ReactiveSituation):
            _expect_free_places(situation)


def _expect_free_places(situation: ReactiveSituation) -> None:
    """Check that no vehicle overlaps an ego at constant velocity when it first appears."""
    before: set[int] = set()
    for step, (ego, there) in enumerate(
        zip(_list_egos(situation), _script(situation), strict=True)
    ):
        for number in there.keys() - before:
            apart = are_apart(ego, there[number])
            expect(apart, f"Vehicle {number} overlaps the ego when it appears, at step {step}.")
        # A vehicle that the ego runs into later is a failure of the ego, not of the scenario.
        before |= there.keys()


def repeats_itself(scenario: Scenario) -> None:
    """The same parameters and seed give the same situation and the same script."""
    for one, other in zip(_situations(scenario), _situations(scenario), strict=True):
        expect(_describe(one) == _describe(other), "The same seed gave two situations.")
        expect(_script(one) == _script(other), "The same seed gave two scripts.")


def has_a_steady_horizon(scenario: Scenario) -> None:
    """Time step and horizon depend on the parameters alone, not on the seed."""
    times = {(one.mission.dt_s, one.steps) for one in _situations(scenario)}
    expect(len(times) == 1, f"Time step and horizon vary with the seed: {sorted(times)}.")


def moves_actors_as_they_say(scenario: Scenario) -> None:
    """A script begins at the start of the actor, and its positions follow from its speeds.

    Vehicles that come and go have numbers from the situation, and at least one is always present. A
    number that has gone is not used again.
    """
    for situation in _situations(scenario):
        dt_s = situation.mission.dt_s
        script = _script(situation)
        for number, start in enumerate(situation.actors, 1):
            first = script[0].get(number)
            expect(first == start, f"The script begins at {first}, the actor at {start}.")
        known = range(1, _count_vehicles(situation) + 1)
        for there in script:
            expect(bool(there), "There is a moment without a vehicle beside the ego.")
            expect(there.keys() <= set(known), f"Vehicles {sorted(there)} are not among {known}.")
        gone: set[int] = set()
        for earlier, later in pairwise(script):
            gone |= earlier.keys() - later.keys()
            back = sorted(gone & later.keys())
            expect(not back, f"Vehicles {back} have gone, and are there again.")
            for number in earlier.keys() & later.keys():
                before, after = earlier[number], later[number]
                way = hypot(after.x_m - before.x_m, after.y_m - before.y_m)
                # The trapezoid: speeds may change within a step, and neither end alone gives the
                # way.
                due = 0.5 * (before.speed_mps + after.speed_mps) * dt_s
                same = (before.length_m, before.width_m) == (after.length_m, after.width_m)
                expect(abs(way - due) <= TOLERANCE_M, f"{before} jumps to {after}.")
                expect(same, f"{before} changes its size to {after}.")


def leaves_no_vehicle_out(scenario: Scenario) -> None:
    """Vehicles of a recording are missing only if the scenario leaves them out on purpose."""
    left_out: Sequence[str] = getattr(scenario, "left_out", ())
    listed = " ".join(left_out[:MOST_LISTED])
    more = f" {len(left_out) - MOST_LISTED} more." if len(left_out) > MOST_LISTED else ""
    expect(
        not left_out,
        f"Left out of its recording: {len(left_out)} of the vehicles. {listed}{more} If that is "
        "intended, name them in `without` of `read_tracks`.",
    )


def _situations(scenario: Scenario) -> Iterator[AnySituation]:
    parameters = read_settings(scenario.Parameters, {}, "scenario_parameters")
    for seed in SEEDS:
        yield scenario(parameters, seed)


def _describe(situation: AnySituation) -> tuple[object, ...]:
    """Return the parts of a situation other than its script."""
    parts = situation.mission, situation.steps, situation.ego, situation.actors
    if isinstance(situation, ReactiveSituation):
        return (*parts, situation.challenges)
    return parts


def _count_vehicles(situation: AnySituation) -> int:
    if isinstance(situation, ReactiveSituation):
        return len(situation.challenges)
    return len(situation.actors)


def _script(situation: AnySituation) -> list[dict[int, VehicleState]]:
    """Return the vehicles at every step by number, for an ego at constant velocity."""
    egos = _list_egos(situation)
    if isinstance(situation, ReactiveSituation):
        traffic = situation.start_traffic()
        script = [dict(enumerate(situation.actors, 1))]
        for step, ego in enumerate(egos[1:], 1):
            script.append(dict(traffic.advance(step, ego)))
        return script
    return [
        {
            actor + 1: situation.move_actor(actor, step, ego)
            for actor in range(len(situation.actors))
        }
        for step, ego in enumerate(egos)
    ]


def _list_egos(situation: AnySituation) -> list[VehicleState]:
    """Return the ego at every step, at constant velocity."""
    start, egos = situation.ego, []
    for step in range(situation.steps):
        way = start.speed_mps * (step * situation.mission.dt_s)
        x_m = start.x_m + way * cos(start.heading_rad)
        y_m = start.y_m + way * sin(start.heading_rad)
        egos.append(msgspec.structs.replace(start, x_m=x_m, y_m=y_m))
    return egos


def are_apart(one: VehicleState, other: VehicleState) -> bool:
    """Return whether two footprints neither touch nor overlap."""
    # Two rectangles are apart if and only if a side of one separates them (separating axes).
    return _separated(one, other) or _separated(other, one)


def _separated(one: VehicleState, other: VehicleState) -> bool:
    """Return whether a side of the first rectangle separates it from the second one."""
    # The centre of the second one, seen from the first one along its heading.
    dx, dy = other.x_m - one.x_m, other.y_m - one.y_m
    cosine, sine = cos(one.heading_rad), sin(one.heading_rad)
    along, across = cosine * dx + sine * dy, cosine * dy - sine * dx
    turn = other.heading_rad - one.heading_rad
    c, s = abs(cos(turn)), abs(sin(turn))
    reach_along = 0.5 * (one.length_m + other.length_m * c + other.width_m * s)
    reach_across = 0.5 * (one.width_m + other.length_m * s + other.width_m * c)
    return abs(along) > reach_along or abs(across) > reach_across


SCENARIO_CHECKS: tuple[Callable[[Scenario], None], ...] = (
    has_valid_defaults,
    is_plausible,
    starts_without_overlap,
    repeats_itself,
    has_a_steady_horizon,
    moves_actors_as_they_say,
    leaves_no_vehicle_out,
)
