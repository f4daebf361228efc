"""How many workers there are to be: quickly enough, within bounds, and without flapping."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eigenfail.hosting.service import Span
from eigenfail_services.campaigns.launcher import (
    RISE_AFTER_S,
    WORK_EACH_S,
    WorkerScale,
    choose_surplus,
    count_needed,
)
from eigenfail_services.hub.metrics import Work

TURN_S = 0.25
ROUNDING_S = 1e-9
IDLE_S = 30.0
SPAN = Span(least=1, most=8, idle_s=IDLE_S)

turns = st.lists(st.tuples(st.floats(0.0, 20.0), st.integers(-5, 30)), min_size=1, max_size=200)
"""How long after the one before [s], and how many workers are needed then."""

spans = st.builds(
    lambda least, more, idle_s: Span(least, least + more, idle_s),
    st.integers(0, 6),
    st.integers(0, 6),
    st.floats(1.0, 100.0),
)


@pytest.mark.parametrize(
    ("episodes", "worker_s", "workers"),
    [
        (0, 0.0, 0),
        (1, 1e-4, 1),
        (1, 3_600.0, 1),
        (256, 256 * 0.001, 1),
        (100, 100 * 0.1, 5),
        (10, 10 * 60.0, 10),
    ],
)
def test_each_worker_has_two_seconds_of_work_and_an_episode(episodes, worker_s, workers) -> None:
    assert count_needed(Work(episodes, worker_s)) == workers


@given(st.integers(0, 10**6), st.floats(0.0, 1e6))
def test_no_more_workers_than_episodes_and_no_fewer_than_the_work_takes(episodes, pace_s) -> None:
    workers = count_needed(Work(episodes, episodes * pace_s))
    assert min(1, episodes) <= workers <= episodes
    assert workers == episodes or workers * WORK_EACH_S >= episodes * pace_s


def history(span: Span, taken: list[tuple[float, int]]) -> list[tuple[float, int]]:
    """When which number was wanted."""
    scale, now_s, found = WorkerScale(span), 0.0, [(0.0, span.least)]
    for passed_s, need in taken:
        now_s += passed_s
        found.append((now_s, scale.look(now_s, need)))
    return found


@given(spans, turns)
def test_it_is_always_within_its_bounds(span, taken) -> None:
    assert all(span.least <= wanted <= span.most for _, wanted in history(span, taken))


@given(spans, turns)
def test_it_falls_only_to_what_was_enough_for_as_long_as_it_is_to_wait(span, taken) -> None:
    found = history(span, taken)
    needs = [(at_s, need) for (at_s, _), (_, need) in zip(found[1:], taken, strict=True)]
    for looks, ((_, before), (at_s, wanted)) in enumerate(itertools.pairwise(found), start=1):
        if wanted < before:
            since_s = at_s - span.idle_s + ROUNDING_S
            lately = [need for when_s, need in needs[:looks] if since_s < when_s]
            assert max(span.least, *lately) <= wanted


@given(spans, turns)
def test_between_a_rise_and_a_fall_nobody_is_needed_for_long(span, taken) -> None:
    found = history(span, taken)
    changes = [
        (at_s, wanted - before)
        for (_, before), (at_s, wanted) in itertools.pairwise(found)
        if wanted != before
    ]
    for (first_s, one), (then_s, other) in itertools.pairwise(changes):
        if one > 0 > other:
            assert then_s - first_s >= span.idle_s - ROUNDING_S
        if one < 0 < other:
            assert then_s - first_s >= RISE_AFTER_S - ROUNDING_S


@given(spans, turns, st.integers(0, 30))
def test_a_need_that_lasts_is_met_within_ten_seconds(span, taken, need) -> None:
    scale, now_s = WorkerScale(span), 0.0
    for passed_s, before in taken:
        now_s += passed_s
        scale.look(now_s, before)
    until_s = now_s + 10.0
    while now_s < until_s:
        now_s += TURN_S
        scale.look(now_s, need)
    assert scale.wanted >= min(max(need, span.least), span.most)


def after(scale: WorkerScale, begin_s: float, end_s: float, need: int) -> int:
    """What is wanted at the end of a time in which so many were needed."""
    for turn in range(int((end_s - begin_s) / TURN_S) + 1):
        scale.look(begin_s + turn * TURN_S, need)
    return scale.wanted


def test_a_moment_of_need_starts_nobody() -> None:
    scale = WorkerScale(SPAN)
    assert after(scale, 0.0, 1.5, need=8) == 1
    assert after(scale, 1.75, 2.0, need=1) == 1
    assert after(scale, 2.25, 3.75, need=8) == 1
    assert after(scale, 4.0, 4.25, need=5) == 5


def test_a_learner_that_trains_between_rounds_costs_no_worker() -> None:
    """Nothing waits while it does, for less than the time that idle workers are kept."""
    scale = WorkerScale(SPAN)
    wanted = []
    for begin_s in range(0, 400, 40):
        wanted += [after(scale, begin_s, begin_s + 15.0, need=6)]
        wanted += [after(scale, begin_s + 15.25, begin_s + 39.75, need=0)]
    assert set(wanted) == {6}
    assert after(scale, 400.0, 440.0, need=0) == SPAN.least


names = st.lists(st.text("abcdef", min_size=1, max_size=2), unique=True)


@given(names, st.data(), st.integers(0, 20))
def test_nobody_who_holds_anything_is_let_go(names, data, n) -> None:
    present = data.draw(st.sets(st.sampled_from(names) if names else st.nothing()))
    idle = data.draw(st.sets(st.sampled_from(sorted(present)) if present else st.nothing()))
    gone = choose_surplus(names, present, idle, n)
    assert len(gone) == len(set(gone)) <= n
    assert set(gone) <= set(names) - (present - idle)
    assert len(gone) == min(n, len(set(names) - (present - idle)))


def test_who_came_last_goes_first_and_before_all_who_is_not_there_yet() -> None:
    assert choose_surplus(["a", "b", "c", "d"], {"a", "b", "c"}, {"a", "c"}, 2) == ["d", "c"]
