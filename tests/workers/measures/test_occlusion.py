"""Vehicles that others hide: hand-worked, invariant, and against rays between all corners."""

from cmath import phase
from itertools import combinations, pairwise
from math import cos, pi, sin

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from eigenfail.values.scene import VehicleState
from eigenfail_workers.measures.geometry import find_hidden, separation

EGO = VehicleState(-5.0, 0.0, 0.0, 20.0, 10.0, 2.5)
"""The sensor is at its front, which is at the origin."""


def box(x: float, y: float, width: float = 2.0, heading: float = 0.0, length: float = 5.0):
    return VehicleState(x, y, heading, 0.0, length, width)


NEAR = box(20.0, 0.0)
"""Its rear, which is seen, is 17.5 m away and reaches 1 m to both sides."""


@pytest.mark.parametrize(
    ("others", "hidden"),
    [
        ((NEAR,), set()),
        ((NEAR, box(40.0, 0.0)), {1}),
        ((box(40.0, 0.0), NEAR), {0}),
        # At 37.5 m the shadow reaches 37.5 / 17.5 = 2.142857 m to both sides.
        ((NEAR, box(40.0, 0.0, 4.28)), {1}),
        ((NEAR, box(40.0, 0.0, 4.29)), set()),
        ((NEAR, box(40.0, 1.14)), {1}),
        ((NEAR, box(40.0, -1.15)), set()),
        # Two side by side hide what one does not, unless something is seen between them.
        ((box(20.0, 1.0), box(20.0, -1.0), box(40.0, 0.0, 8.5)), {2}),
        ((box(20.0, 1.0), box(20.0, -1.0), box(40.0, 0.0, 8.6)), set()),
        ((box(20.0, 1.1), box(20.0, -1.1), box(40.0, 0.0, 8.5)), set()),
        # A hidden vehicle hides others, and one beside the sensor is no exception behind it.
        ((NEAR, box(40.0, 0.0), box(60.0, 0.0)), {1, 2}),
        ((box(-25.0, 0.0), box(-45.0, 0.0), box(-45.0, 9.0)), {1}),
        # Across the ray, its long side is 19 m away and reaches 2.5 m to both sides.
        ((box(20.0, 0.0, 2.0, pi / 2), box(40.0, 0.0, 9.86)), {1}),
        ((box(20.0, 0.0, 2.0, pi / 2), box(40.0, 0.0, 9.88)), set()),
        # A vehicle that touches the sensor is seen, and hides nothing.
        ((box(2.0, 0.0), box(40.0, 0.0)), set()),
        ((box(2.0, 1.1), box(2.0, 20.0)), {1}),
    ],
)
def test_hand_worked(others: tuple[VehicleState, ...], hidden: set[int]) -> None:
    assert find_hidden(EGO, others) == hidden


vehicles = st.builds(
    box,
    st.floats(-30.0, 30.0),
    st.floats(-30.0, 30.0),
    st.floats(0.5, 12.0),
    st.floats(-pi, pi),
    st.floats(0.5, 12.0),
)


def corners(vehicle: VehicleState) -> list[complex]:
    turn = complex(cos(vehicle.heading_rad), sin(vehicle.heading_rad))
    halves = complex(0.5 * vehicle.length_m, 0.5 * vehicle.width_m)
    around = (halves, -halves.conjugate(), -halves, halves.conjugate())
    return [complex(vehicle.x_m, vehicle.y_m) + turn * each for each in around]


def meet(ray: complex, polygon: list[complex]) -> float:
    """The distance at which a ray from the origin first meets a polygon; infinity if never."""
    found = [np.inf]
    for begin, end in zip(polygon, [*polygon[1:], polygon[0]], strict=True):
        a, b = begin / ray, end / ray
        if a.imag * b.imag <= 0.0 and a.imag != b.imag:
            at = a.real + (b.real - a.real) * a.imag / (a.imag - b.imag)
            found.append(at if at > 0.0 else np.inf)
    return min(found)


@settings(deadline=None, derandomize=True, max_examples=300)
@given(st.lists(vehicles, min_size=2, max_size=4))
def test_it_is_what_no_ray_meets_first(others: list[VehicleState]) -> None:
    sensor = VehicleState(0.0, 0.0, 0.0, 0.0, 0.01, 0.01)
    everything = [sensor, *others]
    assume(all(separation(a, b).distance_m > 0.01 for a, b in combinations(everything, 2)))
    outlines = [corners(each) for each in others]
    directions = sorted(phase(each) for outline in outlines for each in outline)
    # Which vehicle a ray meets first changes at the direction of a corner alone.
    gaps = [
        *pairwise(directions),
        (directions[-1], directions[0] + 2 * pi),
    ]
    assume(all(end - begin > 1e-6 or end == begin for begin, end in gaps))
    seen = set()
    for begin, end in gaps:
        middle = 0.5 * (begin + end)
        apart = [meet(complex(cos(middle), sin(middle)), outline) for outline in outlines]
        if min(apart) < np.inf:
            seen.add(apart.index(min(apart)))
    ego = VehicleState(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    assert find_hidden(ego, others) == set(range(len(others))) - seen


@settings(deadline=None, derandomize=True, max_examples=100)
@given(st.lists(vehicles, min_size=2, max_size=4), st.floats(-pi, pi), st.floats(-500.0, 500.0))
def test_it_turns_and_moves_with_the_road(others, turn: float, far: float) -> None:
    def move(each: VehicleState) -> VehicleState:
        at = complex(each.x_m, each.y_m) * complex(cos(turn), sin(turn)) + complex(far, -far)
        heading = (each.heading_rad + turn + pi) % (2 * pi) - pi
        return VehicleState(at.real, at.imag, heading, 0.0, each.length_m, each.width_m)

    # Where corners lie in one direction, rounding decides which of them is met first.
    directions = sorted(phase(each) for other in others for each in corners(other))
    assume(all(end - begin > 1e-6 for begin, end in pairwise(directions)))
    assert find_hidden(move(EGO), [move(each) for each in others]) == find_hidden(EGO, others)
