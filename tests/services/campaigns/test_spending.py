"""What a campaign cost, from a store: modes of the newest analysis, curves, parts of time."""

import numpy as np
import pytest
from msgspec.structs import replace
from store_checks.examples import deliver, running

from eigenfail.testing.examples import analysis_result, collision, make_errored_result, result
from eigenfail.values.analysis import FEWEST_OF_MODE, AnalysisSettings, FailureMode
from eigenfail.values.campaign import Overhead
from eigenfail_services.campaigns.costs import find_spending

CRASHES = (1, 4, 6, 8)


@pytest.fixture
def ran(store) -> int:
    """Nine completed episodes and one that could not be run, in an hour of 1.2 USD."""
    campaign = running(store)
    for index in range(9):
        make = collision if index in CRASHES else result
        deliver(store, campaign, make(index, wall_s=1.0))
    deliver(store, campaign, make_errored_result(9, wall_s=1.0))
    store.campaigns.add_active(campaign.id, 3600.0, Overhead(600.0, 0.0, 0.0))
    return campaign.id


def analyse(store, campaign, labels, *, distinct=True, campaigns=(), small=()) -> int:
    nothing = np.zeros((0, 0), np.float32)
    found = replace(
        analysis_result(),
        episodes=CRASHES[: len(labels)],
        labels=labels,
        modes=tuple(
            FailureMode(1 if mode in small else FEWEST_OF_MODE, 0, nothing, nothing)
            for mode in range(max(labels) + 1)
        ),
        silhouette=0.6,
        noise_silhouette=0.3 if distinct else 0.9,
        campaigns=campaigns,
    )
    analysis = store.analyses.create(campaign, AnalysisSettings())
    store.analyses.start(analysis.id)
    store.analyses.finish(analysis.id, found)
    return analysis.id


def found(store, campaign):
    return find_spending(store, store.campaigns.get(campaign))


def test_without_an_analysis_modes_are_not_known(store, ran) -> None:
    told = found(store, ran)
    assert (told.cost.total_usd, told.cost.per_failure_usd) == (1.2, pytest.approx(0.3))
    assert told.analysis is told.modes is told.per_mode_usd is None
    assert f"eigenfail analyze {ran}" in told.modes_in_words
    assert {point.modes for point in told.curve} == {None}


def test_distinct_modes_have_a_price_and_a_place_on_the_curve(store, ran) -> None:
    analyse(store, ran, (0, 0, 0, 0), distinct=False)
    analysis = analyse(store, ran, (0, 0, 1, 0))
    store.analyses.create(ran, AnalysisSettings())  # not done: it does not count
    told = found(store, ran)
    assert (told.analysis, told.modes, told.per_mode_usd) == (analysis, 2, pytest.approx(0.6))
    rows = {row.index: row.finished_ms for row in store.episodes.page(ran, 10).items}
    firsts = sorted(rows[index] for index in (1, 6))
    landed = sorted(rows[index] for index in range(9))
    wanted = [sum(first <= at for first in firsts) for at in landed]
    assert [point.modes for point in told.curve] == [0, *wanted, 2]
    assert [point.failures for point in told.curve] == [0, 0, 1, 1, 1, 2, 2, 3, 3, 4, 4]


def test_a_mode_of_too_few_failures_has_no_price(store, ran) -> None:
    analyse(store, ran, (0, 0, 1, 0), small=(1,))
    told = found(store, ran)
    assert (told.modes, told.per_mode_usd) == (1, pytest.approx(1.2))
    assert told.modes_in_words.startswith("1 distinct mode, 1 more with too few failures")
    assert told.curve[-1].modes == 1
    analyse(store, ran, (0, 1, 1, 0), small=(0, 1))
    assert (found(store, ran).modes, found(store, ran).per_mode_usd) == (0, None)


def test_modes_that_are_not_distinct_have_no_price(store, ran) -> None:
    analysis = analyse(store, ran, (0, 0, 1, 0), distinct=False)
    told = found(store, ran)
    assert told.analysis == analysis
    assert told.modes is told.per_mode_usd is None
    assert told.modes_in_words.startswith("No distinct modes")


def test_failures_that_an_analysis_does_not_know_are_told(store, ran) -> None:
    analyse(store, ran, (0, 1, 0))
    assert found(store, ran).modes_in_words.endswith("It knows 3 of 4 failures.")


def test_of_several_campaigns_only_its_own_modes_count(store, ran) -> None:
    other = running(store).id
    analyse(store, ran, (0, 1, 2, 1), campaigns=(ran, ran, other, other))
    assert found(store, ran).modes == 2


def test_an_analysis_of_another_campaign_is_not_its_own(store, ran) -> None:
    other = running(store).id
    analyse(store, other, (0, 1, 2, 1), campaigns=(ran, ran, other, other))
    assert found(store, ran).analysis is None


def test_episodes_that_failed_are_lost_time(store, ran) -> None:
    time = found(store, ran).time
    assert (time.worker_s, time.lost_worker_s) == (9.0, 1.0)
    # Monte Carlo learns nothing: its learner only starts.
    assert (time.startup_s, time.learning_s, time.simulation_s) == (600.0, 0.0, pytest.approx(2700))
    assert time.lost_s == pytest.approx(300.0)
