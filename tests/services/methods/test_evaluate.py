"""Evaluation: what was learnt is used as it is, from draws of its own, wherever it fits."""

from functools import cache
from types import MappingProxyType

import msgspec
import numpy as np
import pytest

from eigenfail.errors import InvalidValue, ProtocolError
from eigenfail.plugins import METHODS, load
from eigenfail.settings import read_settings
from eigenfail.testing.learner import Corridor, LearnerSuite, ToyEngine
from eigenfail.values.episode import PolicySource, learner_seed
from eigenfail.values.learning import LearnerContext, Predecessor
from eigenfail_services.campaigns.rounds import Rounds, run_in_process
from eigenfail_services.methods.evaluate import Evaluate

CORRIDOR = Corridor()
CEM = {"batch": 20}
AST = {"round_size": 4, "warm_up": 4, "buffer_size": 70, "gradient_steps": 2}
DIFS = {"round_size": 5, "first_steps": 20, "steps": 10, "memory": 12, "device": "cpu"}
OF_CEM = {"method": "cem", "members": 2, "settings": CEM}


def context(episodes, corridor=CORRIDOR, seed=1, **more):
    nothing = np.zeros((0, corridor.steps, corridor.channels), np.float32)
    return LearnerContext(learner_seed(seed), episodes, corridor.steps, nothing, **more)


def trained(method="cem", settings=CEM, episodes=400, corridor=CORRIDOR, seed=1):
    """What a campaign has learnt, and its results."""
    kind = load(METHODS, method)
    given = context(episodes, corridor, seed)
    learner = kind(given, read_settings(kind.Settings, settings, "settings"))
    results = list(run_in_process(Rounds(learner, seed, episodes), ToyEngine(corridor)))
    before = Predecessor(
        3, method, dict(settings), given.seed, episodes, corridor.steps, learner.state()
    )
    return before, results


def evaluation(before, episodes=100, corridor=CORRIDOR, seed=2, **settings):
    given = read_settings(Evaluate.Settings, {"campaign": 3, **settings}, "settings")
    return Evaluate(context(episodes, corridor, seed, predecessors=(before,)), given)


def evaluated(before, episodes=100, corridor=CORRIDOR, seed=2):
    learner = evaluation(before, episodes, corridor, seed)
    return list(run_in_process(Rounds(learner, seed, episodes), ToyEngine(corridor)))


def rate(results):
    return np.mean([result.is_failure for result in results])


def noise(results):
    return [result.noise.z for result in results]


KNOWN = {"cem": ({"batch": 5}, 20), "ast": (AST, 20), "difs": (DIFS, 20), "ensemble": (OF_CEM, 40)}


@cache
def known(method, corridor):
    """What a short campaign has learnt, which each learner of a suite is born with."""
    settings, episodes = KNOWN[method]
    return trained(method, settings, episodes, corridor)[0]


class EvaluateSuite(LearnerSuite):
    method = Evaluate
    settings = MappingProxyType({"campaign": 3, "round_size": 6})
    before: str

    def context(self, seed, corridor):
        return context(self.budget, corridor, seed, predecessors=(known(self.before, corridor),))


class TestEvaluateOfCem(EvaluateSuite):
    before = "cem"


class TestEvaluateOfAst(EvaluateSuite):
    before = "ast"


class TestEvaluateOfDifs(EvaluateSuite):
    before = "difs"


class TestEvaluateOfAnEnsemble(EvaluateSuite):
    before = "ensemble"


@pytest.fixture(scope="module")
def of_cem():
    """What a campaign of 400 episodes has learnt, and its results."""
    return trained()


def test_fails_as_often_as_training_did_in_the_end_and_learns_no_further(of_cem):
    before, results = of_cem
    found = evaluated(before, 300)
    assert len(found) == 300
    assert rate(results[:40]) < 0.1
    assert abs(rate(found) - rate(results[-100:])) < 0.15
    assert abs(rate(found[:150]) - rate(found[150:])) < 0.15


def test_every_episode_is_drawn_anew_and_by_the_evaluations_own_seed(of_cem):
    before, results = of_cem
    found, again, other = (evaluated(before, 60, seed=seed) for seed in (2, 2, 4))
    same_seed = evaluated(before, 60, seed=1)
    firsts = [{float(z[0, 0]) for z in noise(r)} for r in (results, found, other, same_seed)]
    assert [len(seen) for seen in firsts] == [400, 60, 60, 60]
    assert len(set.union(*firsts)) == 400 + 3 * 60
    np.testing.assert_equal(noise(found), noise(again))


@pytest.mark.parametrize(
    ("method", "settings"),
    [("ast", AST), ("ensemble", {"members": 2, "settings": AST})],
)
def test_a_policy_comes_along_and_fits_episodes_of_any_length(method, settings):
    before, _ = trained(method, settings, 40)
    longer = Corridor(steps=60, wall=9.0)
    first = evaluation(before, corridor=longer).propose(20)
    assert first.sources == (PolicySource(first.policy.version),) * 20
    results = evaluated(before, 50, corridor=longer)
    assert max(result.steps for result in results) == 60
    assert len({float(z[0, 0]) for z in noise(results)}) == 50


def test_noise_of_another_length_is_refused_with_a_remedy():
    before, _ = trained(episodes=40)
    learner = evaluation(before, corridor=Corridor(steps=50))
    with pytest.raises(InvalidValue, match=r"noise of 40 steps, but an episode has 50 here\. Eval"):
        learner.propose(10)


def test_a_method_that_learns_nothing_is_refused_with_a_remedy():
    before, _ = trained("monte_carlo", {}, 20)
    with pytest.raises(InvalidValue, match=r"learns nothing that could be used\. Name a campaign"):
        evaluation(before)


def test_without_its_predecessor_it_is_refused():
    before, _ = trained(episodes=20)
    with pytest.raises(InvalidValue, match="the learner of campaign 4 is not at hand"):
        evaluation(before, campaign=4)


def test_a_damaged_predecessor_is_refused():
    before, _ = trained(episodes=20)
    with pytest.raises(ProtocolError, match="not a state of cem"):
        evaluation(msgspec.structs.replace(before, state=before.state[:-1]))


def test_rounds_are_of_the_size_asked_for():
    before, _ = trained(episodes=20)
    learner = evaluation(before, round_size=7)
    assert [len(learner.propose(n).sources) for n in (100, 7, 3)] == [7, 7, 3]
