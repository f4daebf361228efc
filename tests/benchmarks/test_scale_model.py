"""The model of scale gives what can be worked out by hand, and never more than its bounds."""

from random import Random

import pytest
from benchmarks.speed.scale_model import ROUNDS, limits, predict
from benchmarks.speed.scale_parts import GROUP_S, TURN, Costs, Method, WorkerPool
from benchmarks.speed.scale_simulation import Play
from hypothesis import given, settings
from hypothesis import strategies as st

MANY = 400
"""Rounds of a simulation whose end does not count."""


@pytest.mark.parametrize("workers", [1, 7, 100])
def test_workers_that_wait_for_nobody_work_all_the_time(workers):
    found = predict(Method(1_000, 3), WorkerPool(workers, 1.0), Costs(), 30)
    assert found.episodes_per_s == pytest.approx(workers, rel=0.01)
    assert found.bottleneck == "workers"
    assert found.use["workers"] == pytest.approx(1.0, rel=0.01)


def test_at_its_limit_the_hub_takes_and_commits_as_many_as_there_may_be():
    costs = Costs(result_s=0.001, commit_s=0.2)
    found = predict(Method(20_000, 3), WorkerPool(5_000, 1.0), costs, 12)
    assert found.episodes_per_s == pytest.approx(1.0 / (0.001 + 0.2 / TURN), rel=0.02)
    assert found.bottleneck == "hub"


def test_a_hub_that_is_hardly_used_commits_whoever_came_within_a_groups_time():
    found = predict(Method(1_000, 3), WorkerPool(1, 0.01), Costs(commit_s=0.01), 12)
    assert found.episodes_per_s == pytest.approx(100.0, rel=0.01)
    assert found.use["hub"] == pytest.approx(0.01 / (GROUP_S + 0.01), rel=0.1)


def test_heartbeats_take_their_part_of_the_hub():
    costs = Costs(result_s=0.001, heartbeat_s=1e-4)
    method, pool = Method(20_000, 3), WorkerPool(5_000, 1.0)
    found = predict(method, pool, costs, 12)
    assert found.episodes_per_s == pytest.approx(0.5 / 0.001, rel=0.02)
    assert limits(method, pool, costs)["hub"] == pytest.approx(500.0)


@pytest.mark.parametrize("heartbeats", [0.0, 0.2, 0.5])
def test_a_hub_that_is_not_at_its_limit_works_for_heartbeats_and_results(heartbeats):
    workers = 1_000
    costs = Costs(result_s=2.5e-4, heartbeat_s=heartbeats / workers)
    found = predict(Method(1_000, 3), WorkerPool(workers, 1.0), costs, 60)
    assert found.episodes_per_s == pytest.approx(workers, rel=0.01)
    assert found.use["hub"] == pytest.approx(0.25 + heartbeats, abs=0.01)
    assert found.bottleneck == "workers"


@pytest.mark.parametrize("rounds", [200, 203, 207])
def test_rounds_that_end_in_bursts_are_counted_alike_wherever_the_play_ends(rounds):
    method, pool = Method(100, 14), WorkerPool(1_000, 1.0)  # ten rounds end each second
    play = Play(method, pool, Costs(), lambda: pool.episode_s)
    play.run(rounds)
    assert play.rate == pytest.approx(limits(method, pool, Costs())["workers"], rel=0.01)


@pytest.mark.parametrize(
    ("round_size", "workers", "waves"), [(10, 10, 1), (10, 4, 3), (10, 1, 10), (3, 50, 1)]
)
def test_without_lookahead_a_round_is_its_episodes_its_commit_and_its_learning(
    round_size, workers, waves
):
    found = predict(Method(round_size, 0, learn_s=0.7), WorkerPool(workers, 1.0), Costs(), MANY)
    round_s = waves + GROUP_S + 0.7
    assert found.episodes_per_s == pytest.approx(round_size / round_s, rel=0.005)
    if workers > 1:
        assert found.bottleneck == ROUNDS


def test_the_learning_of_a_round_goes_on_beside_the_next_one():
    pool = WorkerPool(20, 1.0)
    ahead = predict(Method(10, 1, learn_s=0.6), pool, Costs(), MANY)
    assert ahead.episodes_per_s == pytest.approx(20 / (1.0 + GROUP_S + 0.6), rel=0.01)
    slow = predict(Method(10, 1, learn_s=3.0), pool, Costs(), MANY)
    assert slow.episodes_per_s == pytest.approx(10 / 3.0, rel=0.01)
    assert slow.bottleneck == "learner"


def test_a_round_lasts_as_long_as_the_longest_of_its_episodes():
    n, random = 8, Random(1)
    found = predict(
        Method(n, 0), WorkerPool(n, 1.0), Costs(), 4_000, draw=lambda: random.expovariate(1.0)
    )
    longest_s = sum(1.0 / k for k in range(1, n + 1))  # the mean of the largest of n exponentials
    # Who has waited for the whole group's time is committed before the longest is through.
    assert n / found.episodes_per_s == pytest.approx(longest_s + GROUP_S, abs=0.08)


def test_network_and_disk_set_their_own_bounds():
    pool, method = WorkerPool(1_000, 1.0), Method(2_000, 3)
    narrow = Costs(wire_bytes=1_000.0, wire_bytes_per_s=50_000.0)
    found = predict(method, pool, narrow, 20)
    assert (found.episodes_per_s, found.bottleneck) == (50.0, "network")
    slow = Costs(disk_bytes=1_000.0, disk_bytes_per_s=70_000.0)
    found = predict(method, pool, slow, 20)
    assert (found.episodes_per_s, found.bottleneck) == (70.0, "disk")


@given(
    st.fixed_dictionaries(
        {
            "round_size": st.integers(1, 60),
            "lookahead": st.integers(0, 3),
            "learn_s": st.floats(0.0, 1.0),
            "checkpoint_s": st.floats(0.0, 0.02),
        }
    ),
    st.tuples(st.integers(1, 80), st.floats(0.01, 2.0)),
    st.tuples(st.floats(0.0, 0.02), st.floats(0.0, 0.02)),
)
@settings(max_examples=60, deadline=None)
def test_no_part_does_more_than_it_can(told, of_pool, of_hub):
    method, pool, costs = Method(**told), WorkerPool(*of_pool), Costs(*of_hub)
    found = predict(method, pool, costs, 60 + 8 * pool.workers // method.round_size)
    for part, bound in limits(method, pool, costs).items():
        assert found.episodes_per_s <= bound, part
    assert found.use["hub"] <= 1.0
    assert found.episodes_per_s > 0.0
