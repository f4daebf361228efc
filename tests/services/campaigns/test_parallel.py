"""Episodes in parallel: how many are open, for which methods, and that they stay the same."""

from math import ceil

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eigenfail.errors import InvalidValue
from eigenfail.methods import describe_method
from eigenfail.settings import read_settings
from eigenfail.testing.learner import Corridor, ToyEngine
from eigenfail.values import STATE, CampaignSpec, Layer, LearnerContext, Policy, StopRules
from eigenfail.values.learning import IN_FLIGHT, MOST_OPEN_ROUNDS, count_rounds_ahead
from eigenfail_services.campaigns.rounds import Rounds, run_in_process
from eigenfail_services.campaigns.validation import check_spec, find_pace
from eigenfail_services.methods.ast.method import AdaptiveStressTesting
from eigenfail_services.methods.ensemble import Ensemble
from eigenfail_services.methods.monte_carlo import MonteCarlo
from eigenfail_workers.noise.policy import store_policy

STEPS = 5
SPEC = CampaignSpec(
    name="wide", method="monte_carlo", episodes=1000, planner="idm", simulator="point_mass"
)


def make_spec(**changes) -> CampaignSpec:
    return msgspec.structs.replace(SPEC, **changes)


def make_rounds(kind, parallel, budget=200, rules=None, **settings) -> Rounds:
    nothing = np.zeros((0, STEPS, 2), np.float32)
    context = LearnerContext(3, budget, STEPS, nothing, parallel=parallel)
    learner = kind(context, read_settings(kind.Settings, settings, "settings"))
    return Rounds(learner, 3, budget, rules or StopRules())


def run(rounds: Rounds) -> list[tuple[int, bool, bytes]]:
    results = run_in_process(rounds, ToyEngine(Corridor(steps=STEPS)))
    return [(one.index, one.is_failure, one.noise.z.tobytes()) for one in results]


@given(st.integers(1, 100_000), st.integers(1, 10_000), st.integers(0, 4))
def test_the_open_rounds_hold_what_is_to_run_and_not_a_round_more(parallel, size, least) -> None:
    ahead = count_rounds_ahead(parallel, size, least)
    assert ahead >= least
    assert (ahead + 1) * size >= IN_FLIGHT * parallel
    assert ahead == least or ahead * size < IN_FLIGHT * parallel


@given(st.integers(1, 10_000), st.integers(0, 4))
def test_without_a_number_the_method_decides(size, least) -> None:
    assert count_rounds_ahead(None, size, least) == least


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
    assert sum(len(one.tasks) for one in opened) == ceil(IN_FLIGHT * 16 / 4) * 4
    assert run(make_rounds(method, 16, **settings)) == run(make_rounds(method, 16, **settings))
    assert run(make_rounds(method, 16, **settings)) != run(make_rounds(method, None, **settings))


def test_a_rule_on_results_keeps_two_rounds_open() -> None:
    rounds = make_rounds(MonteCarlo, 100, rules=StopRules(failures=5), round_size=10)
    assert len(rounds.open()) == 2


@pytest.mark.parametrize(
    "method", ["cem", "cma", "difs", "subset", "mixture", "chains", "splitting"]
)
def test_methods_that_decide_themselves_refuse_it(method) -> None:
    assert not describe_method(method).traits.tolerates_delay
    settings = {"campaign": 1} if method == "chains" else {}
    given = make_spec(method=method, settings=settings, parallel=100, scenario="cut_in",
                      simulator="highway", episodes=20_000)  # fmt: skip
    with pytest.raises(InvalidValue, match=r"parallel: .* decides itself .* several seeds"):
        check_spec(given)


def test_too_many_rounds_are_refused_with_a_size_that_is_enough() -> None:
    with pytest.raises(InvalidValue, match=r"1500 episodes are open .* 64 rounds of 10 .*to 24"):
        check_spec(make_spec(method="ast", parallel=1000))
    enough = make_spec(method="ast", parallel=1000, settings={"round_size": 24})
    assert find_pace(check_spec(enough)).ahead < MOST_OPEN_ROUNDS


def test_an_open_version_is_never_dropped_however_late_an_episode_is_run_anew() -> None:
    layer = Layer(np.zeros((2, len(STATE)), np.float32), np.zeros(2, np.float32))
    policies: dict[int, Policy] = {}
    for newest in range(300):
        store_policy(policies, Policy(newest, (), layer, layer, 3.0, 5))
        oldest = max(newest - MOST_OPEN_ROUNDS + 1, 0)
        store_policy(policies, Policy(oldest, (), layer, layer, 3.0, 5))
        assert policies.keys() >= set(range(oldest, newest + 1))
