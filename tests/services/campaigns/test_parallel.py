"""Episodes in parallel: how many are open, for which methods, and that they stay the same."""

from math import ceil

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from parallel_rounds import CORRIDOR, describe, make_rounds, play, run

from eigenfail.errors import InvalidValue
from eigenfail.methods import describe_method
from eigenfail.testing.learner import ToyEngine
from eigenfail.values import learning
from eigenfail.values.campaign_spec import CampaignSpec, StopRules
from eigenfail_services.campaigns.validation import check_spec, find_pace
from eigenfail_services.methods.ast.method import AdaptiveStressTesting
from eigenfail_services.methods.ensemble import Ensemble
from eigenfail_services.methods.monte_carlo import MonteCarlo
from eigenfail_services.methods.subset import SubsetMethod
from eigenfail_services.statistics.batches import divide_chains
from eigenfail_workers.noise.policy import store_policy

SPEC = CampaignSpec(
    name="wide", method="monte_carlo", episodes=1000, planner="idm", simulator="point_mass"
)


def make_spec(**changes) -> CampaignSpec:
    return msgspec.structs.replace(SPEC, **changes)


@given(st.integers(1, 100_000), st.integers(1, 10_000), st.integers(0, 4))
def test_the_open_rounds_hold_what_is_to_run_and_not_a_round_more(parallel, size, least) -> None:
    ahead = learning.count_rounds_ahead(parallel, size, least)
    assert ahead >= least
    assert (ahead + 1) * size >= learning.IN_FLIGHT * parallel
    assert ahead == least or ahead * size < learning.IN_FLIGHT * parallel


@given(st.integers(1, 10_000), st.integers(0, 4))
def test_without_a_number_the_method_decides(size, least) -> None:
    assert learning.count_rounds_ahead(None, size, least) == least


@pytest.mark.parametrize("parallel", [None, 1, 40, 150])
def test_monte_carlo_has_the_same_episodes_whatever_runs_in_parallel(parallel) -> None:
    assert run(make_rounds(MonteCarlo, parallel, round_size=10)) == run(
        make_rounds(MonteCarlo, 7, round_size=10)
    )


@pytest.mark.parametrize(
    ("method", "settings"),
    [
        (AdaptiveStressTesting, {"round_size": 4, "warm_up": 4}),
        (Ensemble, {"method": "ast", "members": 2, "settings": {"round_size": 4, "warm_up": 4}}),
    ],
)
def test_policies_learn_from_older_rounds_and_keep_the_workers_busy(method, settings) -> None:
    rounds = make_rounds(method, 16, **settings)
    opened = rounds.open()
    assert sum(len(one.tasks) for one in opened) == ceil(learning.IN_FLIGHT * 16 / 4) * 4
    assert run(make_rounds(method, 16, **settings)) == run(make_rounds(method, 16, **settings))
    assert run(make_rounds(method, 16, **settings)) != run(make_rounds(method, None, **settings))


@given(st.integers(1, 10_000), st.none() | st.integers(1, 10_000))
def test_groups_hold_every_chain_once_and_are_even(chains, parallel) -> None:
    groups = divide_chains(chains, parallel)
    assert np.concatenate(groups).tolist() == list(range(chains))
    sizes = [len(group) for group in groups]
    assert max(sizes) - min(sizes) <= 1
    if parallel is None:
        assert len(groups) == 1
    else:
        assert max(sizes) <= learning.choose_group_size(parallel)
        assert min(sizes) >= 1
        assert len(groups) >= min(chains, 2)


LEVELS = {"budget": 3000, "runs": 3}


@pytest.mark.parametrize("workers", [1, 7, 40])
def test_chains_have_the_same_episodes_for_any_workers(workers) -> None:
    random = np.random.default_rng(workers)
    drawn = play(make_rounds(SubsetMethod, 20, **LEVELS), workers, random.exponential)
    assert drawn.episodes == run(make_rounds(SubsetMethod, 20, **LEVELS))


def test_chains_do_not_wait_for_each_other() -> None:
    narrow = play(make_rounds(SubsetMethod, None, **LEVELS), 20)
    wide = play(make_rounds(SubsetMethod, 20, **LEVELS), 20)
    assert wide.episodes != narrow.episodes
    assert narrow.busy < 0.85
    assert wide.busy > 0.93


@pytest.mark.parametrize("before", [0, 40, 65])
def test_chains_go_on_from_a_checkpoint_with_rounds_open(before) -> None:
    whole = run(make_rounds(SubsetMethod, 20, **LEVELS))
    first, seen = make_rounds(SubsetMethod, 20, **LEVELS), []
    engine = ToyEngine(CORRIDOR)
    for _ in range(before):
        if opened := first.open():
            results = list(engine.run(opened[0].tasks))
            seen += map(describe, results)
            first.complete(results)
    opened = first.open()
    other = make_rounds(SubsetMethod, 20, **LEVELS)
    other.restore(first.checkpoint())
    assert [one.number for one in other.open()] == [one.number for one in opened]
    assert other.checkpoint() == first.checkpoint()
    assert seen + run(other) == whole


def test_as_many_episodes_are_open_as_parallel_takes_until_a_level_ends() -> None:
    rounds, opened = make_rounds(SubsetMethod, 10, budget=3000), []
    engine = ToyEngine(CORRIDOR)
    while now := rounds.open():
        opened.append(sum(len(one.tasks) for one in now))
        rounds.complete(list(engine.run(now[0].tasks)))
    assert max(opened) == learning.OPEN_GROUPS * learning.choose_group_size(10)
    assert np.mean(np.array(opened) >= 10) > 0.9


def test_without_a_number_all_chains_of_subset_move_in_waves() -> None:
    """With the numbers of this release, which later ones are to keep."""
    rounds, sizes = make_rounds(SubsetMethod, None, **LEVELS, round_size=57), []
    engine = ToyEngine(CORRIDOR)
    while opened := rounds.open():
        sizes.append(len(opened[0].tasks))
        rounds.complete(list(engine.run(opened[0].tasks)))
    estimate = rounds.estimate()
    # The first draws of the first run, and nine moves of all of its chains on three levels.
    assert sizes[:31] == [57, 57, 57, 47, *[22] * 27]
    # The other run: draws in rounds of at most 57, then waves of its chains on three levels.
    assert sizes[31:44] == [*[57] * 12, 9]
    assert sizes[44:] == [*[43] * 11, 46, *(57, 2) * 7, *(57, 7) * 2, *(57, 6) * 4, *[24] * 6]
    assert estimate.probability == pytest.approx(0.0007227779906671653, rel=1e-9)
    assert estimate.cv == pytest.approx(0.2551702048683991, rel=1e-9)


@pytest.mark.parametrize(
    ("method", "given", "width"),
    [("subset", {}, 219), ("ensemble", {}, 220)],
)
def test_more_workers_than_there_are_chains_are_refused(method, given, width) -> None:
    if method == "ensemble":
        given = {"method": "subset", "members": 4}
    spec = make_spec(method=method, settings=given, episodes=20_000, parallel=width)
    assert find_pace(check_spec(spec)).width == width
    with pytest.raises(InvalidValue, match=rf"no more than {width} chains .* Set it to {width} or"):
        check_spec(msgspec.structs.replace(spec, parallel=width + 1))


def test_a_stop_rule_that_would_hold_up_chains_is_refused() -> None:
    spec = make_spec(method="subset", episodes=20_000, parallel=100, stop=StopRules(failures=9))
    with pytest.raises(InvalidValue, match=r"two groups of the chains .* one of the two"):
        check_spec(spec)
    check_spec(msgspec.structs.replace(spec, stop=StopRules(wall_s=9.0)))


def test_members_of_an_ensemble_wait_for_their_own_levels_only() -> None:
    given = {"method": "subset", "members": 2, "settings": {"runs": 1}}
    drawn = play(make_rounds(Ensemble, 10, 3000, **given), 7, np.random.default_rng(1).exponential)
    assert drawn.episodes == run(make_rounds(Ensemble, 10, 3000, **given))
    assert drawn.episodes != run(make_rounds(Ensemble, None, 3000, **given))
    assert len(drawn.episodes) == 1157


def test_a_rule_on_results_keeps_two_rounds_open() -> None:
    rounds = make_rounds(MonteCarlo, 100, rules=StopRules(failures=5), round_size=10)
    assert len(rounds.open()) == 2


@pytest.mark.parametrize("method", ["cem", "cma", "difs", "mixture", "splitting"])
def test_methods_that_decide_themselves_refuse_it(method) -> None:
    assert not describe_method(method).traits.tolerates_delay
    given = make_spec(
        method=method, parallel=100, scenario="cut_in", simulator="highway", episodes=5_000
    )
    with pytest.raises(InvalidValue, match=r"parallel: .* decides itself .* several seeds"):
        check_spec(given)


def test_too_many_rounds_are_refused_with_a_size_that_is_enough() -> None:
    with pytest.raises(InvalidValue, match=r"1500 episodes are open .* 64 rounds of 10 .*to 24"):
        check_spec(make_spec(method="ast", parallel=1000))
    enough = make_spec(method="ast", parallel=1000, settings={"round_size": 24})
    assert find_pace(check_spec(enough)).ahead < learning.MOST_OPEN_ROUNDS


def test_an_open_version_is_never_dropped_however_late_an_episode_is_run_anew() -> None:
    layer = learning.Layer(np.zeros((2, len(learning.STATE)), np.float32), np.zeros(2, np.float32))
    policies: dict[int, learning.Policy] = {}
    for newest in range(300):
        store_policy(policies, learning.Policy(newest, (), layer, layer, 3.0, 5))
        oldest = max(newest - learning.MOST_OPEN_ROUNDS + 1, 0)
        store_policy(policies, learning.Policy(oldest, (), layer, layer, 3.0, 5))
        assert policies.keys() >= set(range(oldest, newest + 1))
