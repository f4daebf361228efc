"""Failure modes are recognised from release to release, and chance is told from change."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eigenfail.values.release import ModeStatus
from eigenfail_services.analysis.mode_matching import LEVEL, ReleaseBehaviours, match_modes
from eigenfail_services.analysis.mode_regions import ModeBehaviours, list_clouds, separate_failures

STEPS, STEP_S, EPISODES = 45, 0.1, 1_000
COURSES = {name: -strength * np.ones(STEPS) for name, strength in (("a", 1), ("b", 6), ("c", 11))}

FIRST, STILL, GONE, BACK, OPEN = (
    ModeStatus.FIRST_SEEN,
    ModeStatus.STILL_THERE,
    ModeStatus.NOT_FOUND_AGAIN,
    ModeStatus.REGRESSED,
    ModeStatus.UNDECIDED,
)


def behaviours(name, failures, seed=0, struck=1):
    noise = np.random.default_rng([seed, failures, ord(name)]).normal(size=(failures, 1))
    accelerations = (COURSES[name] + 0.3 * noise).astype(np.float32)
    return ModeBehaviours(accelerations, (struck,) * failures, failures)


def release(*modes, is_random=True, build="", noise="", episodes=EPISODES):
    return ReleaseBehaviours(episodes, is_random, modes, build, noise)


def statuses(*releases):
    return [[each.status for each in mode] for mode in match_modes(releases, STEP_S)]


def test_a_mode_comes_goes_and_comes_back():
    a, b = behaviours("a", 30), behaviours("b", 30)
    told = statuses(
        release(a),
        release(behaviours("a", 25, 1), b),
        release(behaviours("b", 28, 2)),
        release(behaviours("b", 22, 3), behaviours("a", 27, 3)),
    )
    assert told == [[FIRST, STILL, GONE, BACK], [None, FIRST, STILL, STILL]]


@pytest.mark.parametrize(("failures", "status"), [(1, OPEN), (4, OPEN), (5, FIRST), (30, FIRST)])
def test_a_mode_is_new_where_chance_hardly_explains_its_failures(failures, status):
    """A mode is compared by itself: 2^-k is at most 5 % from 5 failures on."""
    found = match_modes((release(), release(behaviours("a", failures))), STEP_S)
    assert found[0][1].status is status
    assert found[0][1].chance == pytest.approx(min(1.0, 0.5**failures))


def test_absence_is_said_where_the_number_of_episodes_makes_it_unlikely():
    few, many = behaviours("a", 3), behaviours("a", 30)
    assert statuses(release(few), release()) == [[FIRST, OPEN]]
    assert statuses(release(many), release()) == [[FIRST, GONE]]
    (found,) = match_modes((release(few), release(episodes=9_000)), STEP_S)
    assert found[1].chance == pytest.approx(0.1**3)
    assert found[1].status is GONE
    # Absence adds up over releases: 3 failures in 1,000 episodes, none in 2,000 after them.
    (found,) = match_modes((release(few), release(), release()), STEP_S)
    assert [each.chance for each in found] == [None, pytest.approx(1 / 8), pytest.approx(1 / 27)]
    assert found[2].status is GONE


@pytest.mark.parametrize(("failures", "status"), [(5, OPEN), (6, FIRST)])
def test_modes_that_are_compared_together_share_the_level(failures, status):
    modes = [behaviours(name, failures) for name in "abc"]
    found = match_modes((release(), release(*modes)), STEP_S)
    assert [each[1].chance for each in found] == [pytest.approx(3 * 0.5**failures)] * 3
    assert (found[0][1].chance <= LEVEL) == (status is FIRST)
    assert {each[1].status for each in found} == {status}


def test_a_search_proves_neither_a_new_mode_nor_that_one_is_gone():
    a, b = behaviours("a", 40), behaviours("b", 40)
    found = match_modes((release(a, is_random=False), release(b, is_random=False)), STEP_S)
    assert [each.status for each in found[0]] == [FIRST, ModeStatus.NOT_MET]
    assert found[0][1].chance is None
    assert [each.status for each in found[1]] == [None, OPEN]


@pytest.mark.parametrize("is_random", [True, False])
def test_the_same_build_changes_nothing(is_random):
    """Neither new, nor gone, nor back, however uneven the numbers of failures are."""

    def draw(*modes, build="x"):
        return release(*modes, is_random=is_random, build=build)

    a = behaviours("a", 40)
    assert statuses(draw(), draw(a)) == [[None, OPEN]]
    (found,) = match_modes((draw(a), draw()), STEP_S)
    assert (found[1].status, found[1].same_as) == (OPEN, 0)
    assert statuses(draw(a, build="y"), draw(), draw(a))[0][2] is OPEN
    assert statuses(draw(a), draw(a)) == [[FIRST, STILL]]


def test_another_build_changes_what_it_does():
    a, none = behaviours("a", 40), release(build="y")
    assert statuses(release(build="x"), release(a, build="y")) == [[None, FIRST]]
    assert statuses(release(a, build="x"), none) == [[FIRST, GONE]]
    # Back to the code of the first release: what it had comes back, and what came after it goes.
    first = release(a, build="x")
    assert statuses(first, none, first) == [[FIRST, GONE, BACK]]
    assert statuses(none, first, none) == [[None, FIRST, GONE]]


def test_the_vehicle_that_was_struck_tells_modes_apart():
    one, other = behaviours("a", 30), behaviours("a", 30, 1, struck=2)
    assert statuses(release(one), release(other)) == [[FIRST, GONE], [None, FIRST]]
    assert statuses(release(one, other), release(other)) == [[FIRST, GONE], [FIRST, STILL]] or (
        statuses(release(one, other), release(other)) == [[FIRST, STILL], [FIRST, GONE]]
    )


def test_parts_of_a_mode_are_one_and_modes_that_an_analysis_joined_are_two():
    whole, far = behaviours("a", 60), behaviours("c", 20)
    order = np.argsort(whole.accelerations[:, 0])
    parts = [
        ModeBehaviours(whole.accelerations[rows], (1,) * len(rows), len(rows))
        for rows in (order[:30], order[30:])
    ]
    joined = ModeBehaviours(
        np.concatenate([whole.accelerations, far.accelerations]), (1,) * 80, 160
    )
    for modes, sizes in ((parts, [60]), ([joined], [120, 40]), ([*parts, far], [60, 20])):
        (clouds,) = list_clouds([modes], STEP_S)
        assert [piece.failures for piece in separate_failures(clouds, modes)] == sizes


def test_failures_stand_for_those_that_were_not_read():
    read = behaviours("a", 20)._replace(failures=2_000)
    (found,) = match_modes((release(read), release(read)), STEP_S)
    assert [each.failures for each in found] == [2_000, 2_000]


def test_a_failure_shorter_than_others_counts_from_its_end():
    """Steps before the first one of a failure are steps without acceleration."""
    course = np.zeros((20, STEPS), np.float32)
    course[:, -10:] = -6.0
    longer, shorter = (ModeBehaviours(each, (1,) * 20, 20) for each in (course, course[:, -10:]))
    assert statuses(release(longer), release(shorter)) == [[FIRST, STILL]]


@settings(max_examples=30, deadline=None)
@given(st.permutations("abc"), st.permutations("abc"), st.integers(0, 99))
def test_the_order_of_modes_changes_nothing(first, second, seed):
    sizes = {"a": 40, "b": 30, "c": 25}
    pair = [
        release(*(behaviours(name, sizes[name], seed + place) for name in order))
        for place, order in enumerate((first, second))
    ]
    found = match_modes(pair, STEP_S)
    assert [[each.failures for each in mode] for mode in found] == [[40, 40], [30, 30], [25, 25]]
    assert found == match_modes(pair, STEP_S)


def test_without_failures_there_is_no_mode():
    assert match_modes((), STEP_S) == ()
    assert match_modes((release(), release()), STEP_S) == ()


def test_releases_with_the_same_noise_are_one_sample():
    """Nine releases without a mode say as much as one, where all have the same episodes."""
    for noise, chance in (("seed 1", 0.5**2), ("", 0.1**2)):
        earlier = [release(noise=noise) for _ in range(9)]
        found = match_modes((*earlier, release(behaviours("a", 2))), STEP_S)
        assert found[0][-1].chance == pytest.approx(chance)
        assert found[0][-1].status is (OPEN if noise else FIRST)


def test_failures_of_the_same_noise_count_once():
    """Nine releases with five failures of the same episodes are compared as one."""
    for noise, chance in (("seed 1", 0.5**5), ("", 0.9**45)):
        same = [release(behaviours("a", 5), noise=noise) for _ in range(9)]
        (found,) = match_modes((*same, release()), STEP_S)
        assert found[-1].chance == pytest.approx(chance)
