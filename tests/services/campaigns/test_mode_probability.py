"""The probability of each mode against closed forms, and where it is refused."""

from math import erfc, sqrt
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace
from store_checks.examples import deliver, running

from eigenfail import plugins
from eigenfail.settings import read_settings
from eigenfail.testing.examples import analysis_result, make_errored_result
from eigenfail.values.analysis import AnalysisResult, FailureMode
from eigenfail.values.campaign import Campaign, CampaignState
from eigenfail.values.disturbance import NoiseTrajectory
from eigenfail.values.episode import EpisodeResult, Outcome
from eigenfail.values.estimates import Estimate
from eigenfail.values.measures import Measures
from eigenfail_services.campaigns.mode_probability import (
    add_probabilities,
    estimate_by_known_proposal,
    estimate_by_levels,
    estimate_by_weights,
    estimate_share,
)
from eigenfail_services.campaigns.references import learner_context
from eigenfail_services.campaigns.rounds import FORMAT, Checkpoint, write_checkpoint
from eigenfail_services.methods.batch_learner import SimulationDriver
from eigenfail_services.methods.subset import estimate_modes
from eigenfail_services.statistics.intervals import log_normal, rate
from eigenfail_services.statistics.subset_simulation import (
    SubsetSettings,
    SubsetSimulation,
)
from eigenfail_services.store.store import Store

HIGH, LOW = 3.0, 3.4
WIDE = {"batch": 200, "min_std": 1.0, "mean_smoothing": 0.05}
"""Settings of `cem` whose failures keep their weights."""


def tail(threshold: float) -> float:
    """P(x > threshold) of a standard normal x."""
    return 0.5 * erfc(threshold / sqrt(2.0))


def robustness(x: np.ndarray) -> np.ndarray:
    """0 beyond HIGH on one side and LOW on the other: two modes of known probability."""
    return np.maximum(np.minimum(HIGH - x, LOW + x), 0.0)


def simulated(budget: int, seed: int) -> tuple[list[float], dict[int, int]]:
    """Robustness of all episodes of a simulation, and the mode of each failure."""
    driver, values, sides = SimulationDriver(simulation(budget, seed)), [], []
    while not driver.is_done:
        x = driver.take_trajectories(budget)[:, 0, 0]
        found = robustness(x).tolist()
        values += found
        sides += (x < 0.0).tolist()
        driver.add_robustness(found)
    failures = [index for index, value in enumerate(values) if value <= 0.0]
    return values, {index: int(sides[index]) for index in failures}


def simulation(budget: int, seed: int) -> SubsetSimulation:
    return SubsetSimulation((1, 2), budget, SubsetSettings(), (seed,))


def test_the_intervals_of_two_modes_hold_their_probabilities() -> None:
    held = 0
    for seed in range(20):
        values, mode_of = simulated(8000, seed)
        told = estimate_modes(simulation(8000, seed), values, mode_of, 2)
        assert told is not None
        for found, truth in zip(told, (tail(HIGH), tail(LOW)), strict=True):
            held += found.interval.low <= truth <= found.interval.high
    assert held >= 35


def test_the_modes_add_up_to_the_whole() -> None:
    values, mode_of = simulated(8000, 1)
    apart = estimate_modes(simulation(8000, 1), values, mode_of, 2)
    together = estimate_modes(simulation(8000, 1), values, dict.fromkeys(mode_of, 0), 1)
    assert together[0].probability == pytest.approx(apart[0].probability + apart[1].probability)


def test_few_lineages_make_no_number() -> None:
    values, mode_of = simulated(600, 0)
    told = estimate_modes(simulation(600, 0), values, mode_of, 2)
    assert told[1].probability is None
    assert "independent first draws" in told[1].problem


def test_before_the_runs_have_ended_there_is_none() -> None:
    values, mode_of = simulated(4000, 1)
    assert estimate_modes(simulation(4000, 1), values[:-1], mode_of, 2) is None
    assert estimate_modes(simulation(4000, 1), [], {}, 2) is None


def ran(store: Store, method: str, episodes: int, **settings: Any) -> tuple[Campaign, Any]:
    """A campaign that failed where the mean longitudinal noise was far off; its learner."""
    made = running(store, method=method, episodes=episodes, settings=settings, seed=3)
    kind = plugins.load(plugins.METHODS, method)
    context = learner_context(made, store)
    learner = kind(context, read_settings(kind.Settings, settings, "settings"))
    first = 0
    while first < episodes:
        sources = learner.propose(episodes - first).sources
        results = [episode(first + row, source.z) for row, source in enumerate(sources)]
        if not results:
            break
        deliver(store, made, *results)
        learner.observe(results)
        first += len(results)
    return store.campaigns.get(made.id), learner


def episode(index: int, z: np.ndarray) -> EpisodeResult:
    off = float(z[:, 0].sum()) / sqrt(len(z))
    collided = abs(off) > 1.0
    return EpisodeResult(
        index=index,
        seed=index,
        outcome=Outcome.COLLISION if collided else Outcome.SAFE,
        steps=len(z),
        noise=NoiseTrajectory(z, np.ones_like(z)),
        source="trajectory",
        measures=Measures(0.0 if collided else 1.0 - abs(off)),
    )


def sides(store: Store, campaign: Campaign) -> dict[int, int]:
    (failures,) = store.episodes.failure_portions(campaign.id)
    each = zip(failures.indices, failures.noise, strict=True)
    return {index: int(z[:, 0].sum() < 0.0) for index, z in each}


def test_the_levels_of_a_stored_campaign_are_gone_through_again(store: Store) -> None:
    campaign, learner = ran(store, "subset", 800)
    told = estimate_by_levels(store, campaign, sides(store, campaign), 2)
    whole = learner.estimate().probability
    assert sum(each.probability for each in told if each) == pytest.approx(whole, rel=1e-9)


def evaluated(store: Store) -> tuple[Campaign, Any]:
    """An evaluation of what a campaign of `cem` learnt."""
    before, learner = ran(store, "cem", 800, **WIDE)
    checkpoint = Checkpoint(
        format=FORMAT,
        campaign_seed=3,
        budget=800,
        number=0,
        episodes=800,
        ended=True,
        policy=None,
        rounds=(),
        learner=learner.state(),
    )
    store.checkpoints.save(before.id, write_checkpoint(checkpoint))
    store.campaigns.move(before.id, CampaignState.DONE)
    return ran(store, "evaluate", 1600, campaign=before.id)


@pytest.mark.parametrize("evaluates", [False, True], ids=["cem", "evaluate"])
def test_weights_are_shared_among_the_modes(store: Store, evaluates: bool) -> None:
    if evaluates:
        campaign, learner = evaluated(store)
        told = estimate_by_known_proposal(store, campaign, sides(store, campaign), 2)
        assert {found.episodes for found in told} == {1600}
    else:
        campaign, learner = ran(store, "cem", 1600, **WIDE)
        told = estimate_by_weights(store, campaign, sides(store, campaign), 2)
    for found in told:
        around = log_normal(found.probability, found.cv)
        assert around.low <= tail(1.0) <= around.high
        assert (found.bound, found.interval) == ("lower", None)
    whole = learner.estimate().probability
    assert sum(each.probability for each in told) == pytest.approx(whole, rel=1e-6)


@pytest.mark.parametrize("estimate", [None, Estimate(by="importance sampling", episodes=9)])
def test_an_evaluation_without_weights_tells_of_no_mode(store: Store, estimate) -> None:
    campaign, _ = evaluated(store)
    store.checkpoints.save(campaign.id, b"state", estimate)
    ended = store.campaigns.move(campaign.id, CampaignState.DONE)
    told = add_probabilities(store, [ended], result(sides(store, ended), 0.6))
    assert [mode.probability is None for mode in told.modes] == [estimate is None] * 2


def test_monte_carlo_counts_the_failures_of_each_mode(store: Store) -> None:
    campaign = running(store, episodes=40, seed=3)
    rng = np.random.default_rng(3)
    given = [episode(index, rng.standard_normal((4, 2))) for index in range(40)]
    deliver(store, campaign, *given[:-2], make_errored_result(38), make_errored_result(39))
    ended = over(store, campaign)
    mode_of = sides(store, ended)
    told = add_probabilities(store, [ended], result(mode_of, 0.6)).modes
    counts = [list(mode_of.values()).count(mode) for mode in (0, 1)]
    assert min(counts) > 0
    for mode, count in zip(told, counts, strict=True):
        found, wanted = mode.probability, rate(count, 38, errored=2)
        assert (found.by, found.episodes) == ("Monte Carlo", 38)
        assert (found.probability, found.interval) == (wanted.value, wanted.interval)
        assert found.cv == pytest.approx(sqrt((1.0 - wanted.value) / (38 * wanted.value)))


def test_intervals_of_counted_modes_hold_their_probabilities() -> None:
    truth, held, rng = (tail(1.0), tail(1.5)), 0, np.random.default_rng(0)
    for _ in range(200):
        x = rng.standard_normal(500)
        counts = (int((x > 1.0).sum()), int((x < -1.5).sum()))
        for count, p in zip(counts, truth, strict=True):
            found = estimate_share(rate(count, 500)).interval
            held += found.low <= p <= found.high
    assert 0.93 * 400 <= held <= 0.97 * 400


def result(mode_of: dict[int, int], silhouette: float) -> AnalysisResult:
    nothing = np.zeros((0, 0), np.float32)
    return replace(
        analysis_result(),
        episodes=tuple(mode_of),
        labels=tuple(mode_of.values()),
        modes=(FailureMode(1, 0, nothing, nothing),) * 2,
        silhouette=silhouette,
        noise_silhouette=0.3,
    )


@pytest.mark.parametrize(
    ("method", "episodes", "settings"),
    [
        ("cem", 1600, WIDE),
        ("subset", 800, {}),
    ],
)
def test_failures_that_landed_after_the_reading_are_not_taken_for_none(
    store: Store, method: str, episodes: int, settings: dict[str, Any]
) -> None:
    begun, _ = ran(store, method, episodes, **settings)
    read = {index: mode for index, mode in sides(store, begun).items() if index < episodes // 2}
    for mode in add_probabilities(store, [begun], result(read, 0.6)).modes:
        assert mode.probability.probability is None
        assert "had not ended when the failures were read" in mode.probability.problem
    ended = over(store, begun)
    told = add_probabilities(store, [ended], result(sides(store, ended), 0.6))
    assert all(mode.probability and mode.probability.probability for mode in told.modes)


def over(store: Store, campaign: Campaign) -> Campaign:
    store.checkpoints.save(campaign.id, b"state")
    return store.campaigns.move(campaign.id, CampaignState.DONE)


def test_only_distinct_modes_of_one_campaign_have_a_probability(store: Store) -> None:
    campaign = over(store, ran(store, "subset", 800)[0])
    found = result(sides(store, campaign), 0.6)
    told = add_probabilities(store, [campaign], found)
    assert all(mode.probability is not None for mode in told.modes)
    doubtful = result(sides(store, campaign), 0.2)
    other = running(store, method="difs")
    for campaigns, given in (([campaign], doubtful), ([campaign, other], found), ([other], found)):
        same = add_probabilities(store, campaigns, given)
        assert all(mode.probability is None for mode in same.modes)
