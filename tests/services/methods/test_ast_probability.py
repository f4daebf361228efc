"""AST's failure probability: known answers, what it refuses, and what its state carries."""

from dataclasses import dataclass
from statistics import NormalDist
from types import MappingProxyType

import numpy as np
import pytest

from eigenfail.contracts import Estimator
from eigenfail.functions import of_batch
from eigenfail.settings import read_settings
from eigenfail.testing.learner import Corridor, LearnerSuite, ToyEngine
from eigenfail.values.episode import learner_seed
from eigenfail.values.learning import LearnerContext, Predecessor
from eigenfail_services.campaigns.rounds import Rounds, run_in_process
from eigenfail_services.methods import archive
from eigenfail_services.methods.ast.method import AdaptiveStressTesting, AstFacts
from eigenfail_services.methods.ast.probability import describe_reach
from eigenfail_services.methods.evaluate import Evaluate
from eigenfail_services.statistics.importance import NOT_YET
from eigenfail_services.statistics.intervals import log_normal
from eigenfail_workers.functions import FunctionEngine

CDF = NormalDist().cdf
CORRIDOR = Corridor(steps=4, gain=0.5, wall=1.2)
RANDOM = {
    "hold": 1,
    "n_step": 1,
    "hidden": (16, 16),
    "batch_size": 32,
    "warm_up": 30,
    "gradient_steps": 2,
    "converged_share": None,
    "alpha": 10.0,
    "c_dist": 10.0,
    "entropy": 1.0,
    "learning_rate": 3e-3,
    "round_size": 50,
}
"""Of a policy that stays random: its failures keep a weight."""
SMALL = {**RANDOM, "amplitude": 3.0, "target_entropy": 1.2, "round_size": 20, "gradient_steps": 1}


class TestWithAnEstimate(LearnerSuite):
    method = AdaptiveStressTesting
    # With one channel an action has at most 0.69 nat.
    settings = MappingProxyType(
        {**SMALL, "round_size": 3, "buffer_size": 100, "target_entropy": 0.6, "warm_up": 6}
    )
    # Of eight rounds the last four count: two of these are played, and one follows.
    budget = 24
    rounds = 6


@dataclass
class OneAxis:
    """Fails once the first longitudinal disturbance of `steps` exceeds the quantile of p."""

    p: float
    steps: int

    def within(self, amplitude):
        """The probability of a failure with all noise within ±amplitude."""
        inside = 2.0 * CDF(amplitude) - 1.0
        return (CDF(amplitude) - 1.0 + self.p) * inside ** (2 * self.steps - 1)

    def engine(self):
        beyond = -NormalDist().inv_cdf(self.p)
        return FunctionEngine(of_batch(lambda z: beyond - z[:, 0, 0]), self.steps)


def context(episodes, horizon, seed=3043, predecessors=()):
    nothing = np.zeros((0, horizon, 2), np.float32)
    return LearnerContext(learner_seed(seed), episodes, horizon, nothing, predecessors)


def ast(episodes, horizon=CORRIDOR.steps, seed=3043, **settings):
    given = read_settings(AdaptiveStressTesting.Settings, settings, "settings")
    return AdaptiveStressTesting(context(episodes, horizon, seed), given)


def run(learner, episodes, engine, seed=3043):
    return list(run_in_process(Rounds(learner, seed, episodes), engine))


def evaluation(learner, episodes, trained, horizon, seed, **settings):
    """What `evaluate` makes of an AST learner that was trained over `trained` episodes."""
    before = Predecessor(7, "ast", settings, learner_seed(seed), trained, horizon, learner.state())
    own = read_settings(Evaluate.Settings, {"campaign": 7, "round_size": 1000}, "settings")
    return Evaluate(context(episodes, horizon, seed, (before,)), own)


def test_its_own_second_half_tells_a_probability_of_a_hundredth():
    problem = OneAxis(1e-2, steps=1)
    learner = ast(2500, 1, **RANDOM, amplitude=3.5, target_entropy=0.9)
    run(learner, 2500, problem.engine())
    found = learner.estimate()
    assert isinstance(learner, Estimator)
    around = log_normal(found.probability, found.cv)
    assert around.low < problem.within(3.5) < around.high
    assert (found.bound, found.interval) == ("lower", None)
    assert (found.by, found.episodes) == ("importance sampling", 1250)
    assert found.cv < 0.12  # that of Monte Carlo with as many episodes: 0.28
    assert "A lower bound: it counts failures whose noise stays within ±3.5 sigma" in found.note
    assert "others are missed, so the true probability may be larger" in found.note


@pytest.mark.parametrize(
    ("problem", "amplitude", "target_entropy", "episodes"),
    [(OneAxis(1e-3, steps=1), 4.0, 0.8, 2000), (OneAxis(1e-2, steps=2), 3.5, 1.0, 4000)],
)
def test_an_evaluation_tells_it_from_one_fixed_policy(problem, amplitude, target_entropy, episodes):
    steps, given = problem.steps, {**RANDOM, "amplitude": amplitude}
    given["target_entropy"] = target_entropy
    learner = ast(600, steps, **given)
    run(learner, 600, problem.engine())
    evaluate = evaluation(learner, episodes, 600, steps, 3043, **given)
    assert isinstance(evaluate, Estimator)
    assert evaluate.estimate() is None
    run(evaluate, episodes, problem.engine())
    found = evaluate.estimate()
    assert found.episodes == episodes
    around = log_normal(found.probability, found.cv)
    assert around.low < problem.within(amplitude) < around.high
    assert found.cv < 0.15  # that of Monte Carlo with as many episodes: 0.7 at 1e-3


def test_failures_that_no_action_reaches_are_not_counted():
    """The untrained policy reaches less than half of them."""
    problem = OneAxis(0.1, steps=1)
    learner = ast(2000, 1, **RANDOM, amplitude=1.6, patience=None)
    learner._warm_up = 2000
    run(learner, 2000, problem.engine())
    found = learner.estimate()
    assert problem.within(1.6) < 0.5 * problem.p
    around = log_normal(found.probability, found.cv)
    assert around.low < problem.within(1.6) < around.high < 0.6 * problem.p


def test_how_much_of_the_noise_is_within_reach_stands_in_words():
    assert (
        "within ±2 sigma at every step, as 0.00902 % of all noise does over 100"
        in describe_reach(2, 100, 2)
    )
    assert "within ±4 sigma at every step, as 98.7 % of all noise does over 100" in describe_reach(
        4, 100, 2
    )
    assert "0.00902 % of all noise does over 40" in describe_reach(2, 40, 5)


@pytest.mark.parametrize("hold", [2, 10])
def test_noise_that_is_held_has_no_density_and_no_estimate(hold):
    learner = ast(200, **{**SMALL, "hold": hold})
    run(learner, 200, ToyEngine(CORRIDOR))
    assert learner.estimate() is None
    assert archive.read("ast", learner.state(), AstFacts)[0].sums.episodes == 0
    evaluate = evaluation(learner, 50, 200, CORRIDOR.steps, 1, **{**SMALL, "hold": hold})
    run(evaluate, 50, ToyEngine(CORRIDOR))
    assert evaluate.estimate() is None


def test_a_policy_without_randomness_is_refused_with_a_remedy():
    learner = ast(200, **SMALL)
    actor = learner._trainer.actor
    actor.layers[-1][1][..., 2:] = -30.0
    learner._warm_up = 1_000_000
    run(learner, 200, ToyEngine(Corridor(steps=4, wall=-1e9)))
    found = learner.estimate()
    assert found.probability is found.cv is found.effective is None
    assert "has no density to be weighed by. Take method subset, or" in found.problem
    again = ast(200, **SMALL)
    again.restore(learner.state())
    assert again.estimate() == found


def test_failures_worth_too_little_are_refused_with_a_remedy():
    learner = ast(200, **SMALL)
    run(learner, 200, ToyEngine(CORRIDOR))
    found = learner.estimate()
    assert found.probability is None
    assert 0.0 < found.effective < 100.0
    assert "a number would be far too small" in found.problem
    assert "target_entropy = 0.5" in found.problem


def test_before_half_of_the_budget_is_spent_there_is_nothing_to_tell():
    learner = ast(100, **SMALL)
    rounds, engine, said = Rounds(learner, 0, 100), ToyEngine(CORRIDOR), []
    assert learner.estimate() is None
    while opened := rounds.open():
        engine.add_policy(opened[0].policy)
        rounds.complete(list(engine.run(opened[0].tasks)))
        said.append(learner.estimate())
    assert [one.episodes for one in said] == [0, 0, 0, 20, 40]
    assert {one.problem for one in said[:3]} == {NOT_YET}


def test_episodes_that_could_not_be_run_do_not_count():
    learner = ast(100, **SMALL)
    run(learner, 100, ToyEngine(CORRIDOR, faulty=range(0, 100, 2)))
    assert learner.estimate().episodes == 20


def test_every_round_is_weighed_by_the_policy_that_ran_it():
    """The next round's policy is already out, and trained, when a round comes back."""
    learner, engine = ast(400, **SMALL), ToyEngine(CORRIDOR)
    rounds, sums = Rounds(learner, 3043, 400), learner._probability.sums
    while opened := rounds.open():
        engine.add_policy(opened[0].policy)
        results = list(engine.run(opened[0].tasks))
        if opened[0].tasks[0].index >= 200:
            sums = learner._probability.weigh(sums, results, opened[0].policy)
        rounds.complete(results)
    assert learner._probability.sums == sums
    assert sums.failures > 20


@pytest.fixture(scope="module")
def whole():
    """A learner that was never interrupted."""
    learner = ast(240, **SMALL)
    run(learner, 240, ToyEngine(CORRIDOR))
    return learner


@pytest.mark.parametrize("stop", [110, 130])
def test_a_campaign_that_was_restored_tells_the_same(whole, stop):
    """Interrupted before and within the half that counts."""
    learner, engine = ast(240, **SMALL), ToyEngine(CORRIDOR)
    rounds, done = Rounds(learner, 3043, 240), 0
    while (opened := rounds.open()) and done < stop:
        engine.add_policy(opened[0].policy)
        rounds.complete(list(engine.run(opened[0].tasks)))
        done += len(opened[0].tasks)
    again = ast(240, **SMALL)
    later = Rounds(again, 3043, 240)
    later.restore(rounds.checkpoint())
    list(run_in_process(later, ToyEngine(CORRIDOR)))
    assert again.estimate() == whole.estimate()
    assert again.state() == whole.state()
