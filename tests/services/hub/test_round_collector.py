"""Rounds come back whole, in index order, oldest first."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eigenfail.values.episode import EpisodeFault, EpisodeTask, PriorSource, unrunnable
from eigenfail.values.learning import Layer, Policy, Round
from eigenfail_services.hub.open_rounds import RoundCollector


def task(index: int) -> EpisodeTask:
    return EpisodeTask(index, index, PriorSource())


def result(index: int):
    return unrunnable(task(index), EpisodeFault("input", "test"))


@given(st.lists(st.integers(1, 7), min_size=1, max_size=5), st.randoms(use_true_random=False))
@settings(max_examples=60, deadline=None)
def test_results_in_any_order_give_rounds_in_order(sizes, random) -> None:
    bounds = np.cumsum([0, *sizes]).tolist()
    rounds = [
        Round(n, tuple(task(i) for i in range(*bounds[n : n + 2]))) for n in range(len(sizes))
    ]
    collector, seen = RoundCollector(), []
    assert [t.index for t in collector.open(rounds)] == list(range(bounds[-1]))
    arrivals = list(range(bounds[-1])) * 2
    random.shuffle(arrivals)
    for index in arrivals:
        collector.add(result(index))
        while whole := collector.pop_complete():
            seen.append([r.index for r in whole])
    assert seen == [[t.index for t in r.tasks] for r in rounds]


def test_a_round_that_was_named_before_opens_once() -> None:
    collector = RoundCollector()
    rounds = (Round(0, (task(0), task(1))),)
    assert len(collector.open(rounds)) == 2
    assert collector.open(rounds) == ()


def test_a_stranger_s_result_is_ignored() -> None:
    collector = RoundCollector()
    collector.open((Round(0, (task(3),)),))
    collector.add(result(99))
    assert collector.pop_complete() is None
    collector.add(result(3))
    assert [r.index for r in collector.pop_complete() or ()] == [3]


def test_policies_of_open_rounds_are_at_hand() -> None:
    layer = Layer(np.zeros((2, 2), np.float32), np.zeros(2, np.float32))
    policy = Policy(5, (), layer, layer, 3.0, 1)
    collector = RoundCollector()
    collector.open((Round(0, (task(0),), policy),))
    assert collector.find_policy(5) is policy
    with pytest.raises(KeyError):
        collector.find_policy(4)
