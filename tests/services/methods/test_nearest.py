"""The search for the first failing point between a centre and its medoid, on known ways."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eigenfail.errors import InvalidValue
from eigenfail.values.episode import TrajectorySource
from eigenfail.values.learning import LearnerContext
from eigenfail_services.methods.nearest import (
    GRID,
    HALVINGS,
    MOST_EPISODES,
    NearestFailingPoint,
    NearestSearch,
    NearestSettings,
    find_nearest,
    mix_noise,
    place_trials,
)


def search(*fails) -> NearestSearch:
    """Search ways on which these functions of t say what fails."""
    found = NearestSearch(len(fails))
    while opened := found.open(1000):
        found.close([fails[each.mode](each.t) for each in opened])
    return found


def test_a_centre_that_fails_is_found_in_one_episode() -> None:
    found = search(lambda t: True)
    assert [(each.mode, each.t, each.failed) for each in found.trials] == [(0, 0.0, True)]
    assert find_nearest(found.read(0)) == 0.0


@given(st.floats(0.001, 1.0))
def test_a_border_is_found_to_a_64th_of_the_grid(border: float) -> None:
    found = search(lambda t: t >= border)
    nearest = find_nearest(found.read(0))
    assert border <= nearest <= border + 1.0 / (GRID * 2**HALVINGS)
    assert len(found.trials) == MOST_EPISODES


def test_the_first_of_several_failing_stretches_counts() -> None:
    found = search(lambda t: 0.2 <= t <= 0.3 or t >= 0.7)
    assert find_nearest(found.read(0)) == pytest.approx(0.2, abs=0.002)


def test_where_nothing_before_the_medoid_fails_the_search_comes_close_to_it() -> None:
    found = search(lambda t: False)
    assert find_nearest(found.read(0)) == 1.0
    assert max(found.read(0)) > 0.99


def test_modes_are_searched_side_by_side() -> None:
    found = search(lambda t: t >= 0.5, lambda t: True, lambda t: t >= 0.9)
    nearest = [find_nearest(found.read(mode)) for mode in range(3)]
    assert nearest == pytest.approx([0.5, 0.0, 0.9], abs=0.002)
    assert len(found.trials) == 1 + 2 * MOST_EPISODES


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=4), st.integers(0, 60))
def test_what_was_tried_follows_from_the_outcomes(borders: list[float], most: int) -> None:
    found = search(*((lambda t, border=border: t >= border) for border in borders))
    outcomes = [bool(each.failed) for each in found.trials]
    assert place_trials(len(borders), outcomes) == found.trials
    assert place_trials(len(borders), outcomes[:most]) == found.trials[:most]


def test_noise_is_mixed_on_a_straight_way() -> None:
    centre, medoid = np.full((4, 2), 1.0, np.float32), np.full((4, 2), 3.0, np.float32)
    ends = TrajectorySource(centre, seed=1), TrajectorySource(medoid, seed=2)
    assert np.all(mix_noise(*ends, 0.25).z == 1.5)
    assert np.array_equal(mix_noise(*ends, 0.0).z, centre)
    assert np.array_equal(mix_noise(*ends, 1.0).z, medoid)
    assert mix_noise(*ends, 0.0).seed == 2


@pytest.mark.parametrize("count", [0, 3])
def test_what_are_no_pairs_is_refused(count: int) -> None:
    noise = np.zeros((count, 5, 2), np.float32)
    context = LearnerContext(seed=0, episodes=9, horizon=5, trajectories=noise)
    with pytest.raises(InvalidValue, match=f"name {count} trajectories"):
        NearestFailingPoint(context, NearestSettings(analysis=1))
