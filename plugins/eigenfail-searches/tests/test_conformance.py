"""The shipped suite of learners, over the methods of the plug-in."""

from types import MappingProxyType
from typing import ClassVar

import numpy as np
import pytest
from odd_problems import ODD, check_broken_episodes, check_end

from eigenfail import plugins
from eigenfail.errors import InvalidValue
from eigenfail.methods import describe_method, traits_of
from eigenfail.testing.learner import LearnerSuite
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.learning import LearnerContext
from eigenfail_searches.annealing import SimulatedAnnealing
from eigenfail_searches.chains.method import FailureChains
from eigenfail_searches.go_explore import GoExplore
from eigenfail_searches.mixture_ce.method import MixtureCrossEntropy
from eigenfail_searches.optuna_search import OptunaSearch
from eigenfail_services.campaigns.validation import check_spec

METHODS = {
    "annealing": SimulatedAnnealing,
    "go_explore": GoExplore,
    "mixture_ce": MixtureCrossEntropy,
    "optuna": OptunaSearch,
}
VARIED = {"distance_m": {"uniform": [52, 70]}, "actor_speed_mps": {"choice": [12.0, 16.0]}}
"""Parameters of `cut_in` that are drawn for each episode."""


class TestSimulatedAnnealing(LearnerSuite):
    method = SimulatedAnnealing
    settings = MappingProxyType({"hold": 7, "runs": 4, "restart": 5})


class TestGoExplore(LearnerSuite):
    method = GoExplore
    settings = MappingProxyType({"hold": 7, "round_size": 6})


class TestMixtureCrossEntropy(LearnerSuite):
    method = MixtureCrossEntropy
    settings = MappingProxyType({"initial": 10, "round_size": 5})


class TestParzenEstimator(LearnerSuite):
    method = OptunaSearch
    settings = MappingProxyType({"hold": 7, "round_size": 6})


class TestGaussianProcess(LearnerSuite):
    method = OptunaSearch
    settings = MappingProxyType({"sampler": "gp", "hold": 20, "round_size": 3})


class TestParetoSearch(LearnerSuite):
    method = OptunaSearch
    settings = MappingProxyType({"sampler": "nsga2", "hold": 7, "round_size": 6})


class TestChains(LearnerSuite):
    method = FailureChains
    settings = MappingProxyType({"campaign": 1, "chains": 4})
    budget = 60

    parallel: ClassVar[int | None] = None

    def context(self, seed, corridor):
        shape = 9, corridor.steps, corridor.channels
        noise = np.random.default_rng(seed).normal(1.5, 1.0, shape).astype(np.float32)
        return LearnerContext(seed, self.budget, corridor.steps, noise, parallel=self.parallel)


class TestChainsInParallel(TestChains):
    settings = MappingProxyType({"campaign": 1, "chains": 12})
    budget = 130
    rounds = 6
    parallel = 12


def make_spec(**changes):
    given = {"name": "first", "method": "annealing", "episodes": 10, "planner": "idm"}
    return CampaignSpec(**(given | changes))


@pytest.mark.parametrize("name", METHODS)
def test_a_method_is_found_by_its_name_and_takes_its_defaults(name):
    assert plugins.load(plugins.METHODS, name) is METHODS[name]
    assert check_spec(make_spec(method=name, episodes=500)).method.name == name


@pytest.mark.parametrize("name", METHODS)
def test_references_are_settings_of_the_method(name):
    method = describe_method(name)
    assert set(method.traits.references) <= set(method.settings_type.__struct_fields__)


def test_no_method_has_the_place_of_another_in_charts():
    marks = [traits_of(name).chart_mark for name in plugins.names(plugins.METHODS)]
    assert len(set(marks)) == len(marks)


ON_ODD_PROBLEMS = {
    "annealing": {"hold": 2},
    "mixture_ce": {},
    "optuna": {"hold": 2},
}


@pytest.mark.parametrize("name", ODD)
@pytest.mark.parametrize("method", ON_ODD_PROBLEMS)
def test_it_ends_in_order_on_problems_with_nothing_to_learn(method, name):
    check_end(method, ON_ODD_PROBLEMS[method], name)


@pytest.mark.parametrize("method", ON_ODD_PROBLEMS)
def test_episodes_that_cannot_be_run_do_not_stop_it(method):
    check_broken_episodes(method, ON_ODD_PROBLEMS[method])


@pytest.mark.parametrize("method", METHODS)
def test_episodes_at_once_are_refused_since_it_decides_itself(method):
    assert not describe_method(method).traits.tolerates_delay
    given = make_spec(method=method, parallel=100, scenario="cut_in", episodes=5_000)
    with pytest.raises(InvalidValue, match=r"parallel: .* decides itself .* several seeds"):
        check_spec(given)


def test_what_continues_episodes_is_refused_where_parameters_are_drawn():
    with pytest.raises(InvalidValue, match="distance_m, actor_speed_mps drawn") as refusal:
        check_spec(make_spec(method="go_explore", scenario_parameters=VARIED))
    assert refusal.value.field == "scenario_parameters"


def test_what_continues_episodes_is_refused_for_functions(monkeypatch):
    monkeypatch.setenv("EIGENFAIL_FUNCTIONS", "m")
    function = {"simulator": "function", "scenario": "function", "planner": "m:f"}
    spec = make_spec(method="go_explore", **function, scenario_parameters={"steps": 7})
    with pytest.raises(InvalidValue, match="functions have no steps"):
        check_spec(spec)
