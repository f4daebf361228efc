"""Subset simulation as a learner, against probabilities in closed form."""

from math import sqrt
from statistics import NormalDist

import numpy as np
import pytest
from scipy.stats.qmc import Sobol

from eigenfail.errors import InvalidValue, ProtocolError
from eigenfail.settings import read_settings
from eigenfail.values.episode import learner_seed
from eigenfail.values.learning import LearnerContext
from eigenfail_services.campaigns.rounds import Rounds, run_in_process
from eigenfail_services.methods.subset import MOST_VALUES, SubsetMethod
from eigenfail_services.statistics.subset_simulation import (
    PLANNED_LEVELS,
    SubsetSettings,
    simulate_subsets,
)

STEPS = 5
SEED = 3004


def half_space(p):
    """Distance to a plane through the noise beyond which lies a share p of all noise."""
    reach = -NormalDist().inv_cdf(p)
    return lambda z: reach - z.reshape(len(z), -1).sum(axis=1) / sqrt(z[0].size)


def hidden(z):
    """A slope that leads nowhere soon, and a cliff beside it that few first draws come near."""
    return np.minimum(5.5 - z[:, 0, 0], 8.0 * (3.7 - z[:, 0, 1]))


def subset(episodes, steps=STEPS, seed=SEED, **settings):
    nothing = np.zeros((0, steps, 2), np.float32)
    given = read_settings(SubsetMethod.Settings, settings, "settings")
    return SubsetMethod(LearnerContext(learner_seed(seed), episodes, steps, nothing), given)


@pytest.fixture
def searched(noise_engine):
    """A whole campaign: its learner and its results."""

    def run(robustness, episodes, *, broken=None, **settings):
        learner = subset(episodes, **settings)
        rounds = Rounds(learner, 0, episodes)
        return learner, list(run_in_process(rounds, noise_engine(robustness, broken)))

    return run


def test_one_run_gives_the_numbers_of_the_statistics(searched):
    far = half_space(1e-4)

    def injected(z):
        return np.maximum(far(z.astype(np.float32).astype(np.float64)), 0.0)

    learner, _ = searched(far, 10_000, runs=1)
    found = learner.estimate()
    seed = learner_seed(SEED)
    alone = simulate_subsets(injected, (STEPS, 2), 10_000, SubsetSettings(runs=1), seed)
    (run,) = alone.runs
    assert found.probability == pytest.approx(run.result.probability, rel=1e-12)
    assert found.cv == pytest.approx(run.result.cv, rel=1e-12)
    assert found.interval.high == pytest.approx(run.result.interval.high, rel=1e-9)
    assert found.effective == run.result.effective_first_draws
    assert found.episodes == alone.trajectories_run
    assert "no second run" in found.note


def test_failures_that_the_levels_pass_by_are_met_by_wider_noise(searched):
    truth = 1.0 - NormalDist().cdf(5.5) * NormalDist().cdf(3.7)
    found = [
        searched(hidden, 8_000, steps=1, seed=seed)[0].estimate() for seed in range(3000, 3008)
    ]
    numbers = [one for one in found if one.interval]
    held = [one for one in numbers if one.interval.low <= truth <= one.interval.high]
    assert [one for one in found if one.problem.startswith("Wider noise meets failures")]
    assert len(held) >= 0.8 * len(numbers) > 0
    assert all("samples on a level are few" in one.note for one in numbers if one not in held)


def test_noise_of_more_values_than_sobol_points_have_is_refused():
    assert Sobol.MAXDIM == MOST_VALUES
    nothing = np.zeros((0, 7068, 3), np.float32)
    with pytest.raises(InvalidValue, match="7068 steps have 21204"):
        SubsetMethod(LearnerContext(0, 1000, 7068, nothing), SubsetMethod.Settings())


def test_few_samples_are_called_few(searched):
    few = searched(half_space(0.2), 1_000, samples=400)[0].estimate()
    many = searched(half_space(0.2), 10_000)[0].estimate()
    assert "400 samples on a level are few" in few.note
    assert "few" not in many.note
    assert "no sample came near" in many.note


def test_it_ends_when_the_estimate_is_done(searched):
    learner, results = searched(half_space(0.2), 5_000, samples=100)
    assert len(results) == 2 * 100 + 10
    assert learner.estimate().probability == pytest.approx(0.2, rel=0.3)
    assert learner.propose(100).sources == ()


def test_without_a_failure_it_says_how_far_it_came(searched):
    flat = searched(lambda z: np.full(len(z), 3.0), 2_000)[0].estimate()
    walled = searched(lambda z: np.maximum(half_space(1e-5)(z), 1.0), 20_000)[0].estimate()
    assert flat.probability is walled.probability is walled.interval is None
    assert "No failure was reached: robustness falls no further" in flat.problem
    assert "Robustness is 1 m or less with a probability of about" in walled.problem
    assert "nothing of failures of which no sample came near" in walled.problem


def test_an_unconfirmed_interval_over_more_than_four_orders_of_magnitude_is_refused(searched):
    told = [searched(hidden, 2_000, steps=1, seed=seed)[0].estimate() for seed in range(3000, 3010)]
    wide = [one.problem for one in told if one.problem and "independent first draws" in one.problem]
    assert wide
    low, high = map(float, wide[0].partition("from ")[2].split(". ")[0].split(" to "))
    assert high > 1e4 * low


def test_a_budget_that_ends_too_soon_is_spent_and_gives_no_number(searched):
    """Most episodes cannot be run, and first draws are made anew."""
    learner, results = searched(half_space(1e-3), 1_000, broken=lambda z: z[:, 0, 0] < 0.8)
    found = learner.estimate()
    assert len(results) == 1_000
    assert found.probability is None
    assert found.problem.startswith("The budget ended before the second run did.")
    short, _ = searched(half_space(1e-6), 450, broken=lambda z: z[:, 0, 0] < 2.5)
    assert short.estimate().problem.startswith("The budget ended before the first level did.")


def test_failures_beyond_too_many_levels_are_refused_with_what_helps(searched):
    learner, results = searched(half_space(1e-12), 2_000)
    found = learner.estimate()
    assert len(results) == found.episodes == 2_000
    assert found.probability is None
    assert found.problem.startswith("No failure was reached: the other runs need the episodes")
    before, drawn = found.problem.split(" None of the ")
    fewer = int(before.removesuffix(".").rpartition(" ")[2])
    assert before.endswith(f"came near. Set samples to {fewer}.")
    left = int(drawn.split()[0])
    bound = 1.0 - 0.05 ** (1.0 / left)
    assert drawn.endswith(f"failed: P is at most {bound:.1e} with 95 % confidence.")
    told = searched(half_space(1e-12), 2_000, samples=fewer)[0].estimate()
    assert not told.problem.startswith("No failure was reached")


def test_where_robustness_falls_no_further_the_rest_is_drawn_plainly(searched):
    """A plateau shows no way to the failures, P = Q(3.7), of which the first draws hold none."""
    learner, _ = searched(lambda z: np.where(z[:, 0, 0] > 3.7, 0.0, 1.0), 20_000)
    found = learner.estimate()
    assert (found.by, found.episodes) == ("Monte Carlo", 20_000)
    assert found.interval.low < 1.078e-4 < found.interval.high
    assert "Subset simulation gave no number. No failure was reached" in found.note
    learner, results = searched(lambda z: np.ones(len(z)), 2_000)
    found = learner.estimate()
    assert len(results) == 2_000
    assert "robustness falls no further" in found.problem
    assert "None of the" in found.problem


def test_on_the_way_it_says_that_it_is_not_known_yet(noise_engine):
    learner = subset(2_000)
    rounds = Rounds(learner, SEED, 2_000)
    engine = noise_engine(half_space(1e-5))
    assert learner.estimate() is None
    for _ in range(5):
        (opened,) = rounds.open()
        rounds.complete(list(engine.run(opened.tasks)))
    assert learner.estimate().problem.startswith("Not known yet. Robustness is")
    assert learner.estimate().episodes == 218 + 4 * 22
    while not learner.estimate().problem.endswith("The first run has reached failures."):
        (opened,) = rounds.open()
        rounds.complete(list(engine.run(opened.tasks)))
    assert learner.estimate().problem.startswith("Not known yet.")


def test_what_cannot_be_run_counts_as_no_failure(searched):
    """Half of the noise cannot be run, and half of that which fails: P(fail, can be run) = p / 2.

    The product of the shares was P(fail | can be run), which may be above P(fail).
    """
    p = 1e-3

    def left(z):
        return z[:, 0, 0] - z[:, 0, 1] > 0.0

    learner, results = searched(half_space(p), 12_000, broken=left)
    found, ran = learner.estimate(), [r for r in results if r.measures]
    assert found.episodes == len(ran) < len(results)
    assert found.interval.low <= p / 2.0 <= found.interval.high
    assert found.probability < 0.75 * p


def test_nothing_that_can_be_run_spends_the_budget_without_a_number(searched):
    learner, results = searched(half_space(0.5), 500, broken=lambda z: z[:, 0, 0] < 9.0, samples=50)
    assert len(results) == 500
    assert learner.estimate().probability is None
    assert learner.estimate().problem == "Every episode errored: correct what raised."


@pytest.mark.parametrize("cut", [0, 3, 200, 315, 400, 700])
def test_a_restored_learner_goes_on_bit_for_bit(noise_engine, cut):
    engine = noise_engine(half_space(1e-4))

    def play(learner, rounds, count):
        said = []
        while count > 0 and (sources := learner.propose(min(count, rounds)).sources):
            tasks = [Task(i, source) for i, source in enumerate(sources)]
            learner.observe(list(engine.run(tasks)))
            said += [source.z.tobytes() for source in sources]
            count -= len(sources)
        return said

    learner = subset(5_000)
    play(learner, 45, cut)
    restored = subset(5_000)
    restored.restore(learner.state())
    assert restored.state() == learner.state()
    assert restored.estimate() == learner.estimate()
    assert play(restored, 1000, 600) == play(learner, 1000, 600)
    assert restored.estimate() == learner.estimate()


class Task:
    """An episode task in short."""

    seed = 0
    source_kind = "trajectory"

    def __init__(self, index, source):
        self.index, self.source = index, source


def test_a_state_of_more_episodes_than_were_asked_for_is_refused(searched):
    learner, _ = searched(half_space(0.2), 3_000)
    with pytest.raises(ProtocolError, match="more episodes than"):
        # With fewer samples on its only level it has ended sooner.
        subset(3_000, samples=20).restore(learner.state())


def test_a_long_campaign_has_a_small_state(searched):
    learner, results = searched(half_space(1e-6), 5_000)
    assert len(learner.state()) < 8 * len(results) + 500


@pytest.mark.parametrize("runs", [1, 2, 5])
def test_the_smallest_budget_suffices_for_all_runs(runs, searched):
    fewest = SubsetMethod.Settings(runs=runs).count_fewest_trajectories()
    with pytest.raises(InvalidValue, match=rf"fewer than 20 samples .* take {fewest}\."):
        subset(fewest - 1, runs=runs)
    assert len(subset(fewest, runs=runs).propose(1000).sources) == 20
    learner, results = searched(half_space(10.0 ** -(PLANNED_LEVELS - 1)), fewest, runs=runs)
    assert len(results) <= fewest
    assert learner.estimate() is not None
