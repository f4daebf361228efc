"""The choice of estimator, and the ends that campaigns with stop rules come to."""

import numpy as np
import pytest
from msgspec.structs import replace

from eigenfail.presentation.rates import explain_design, format_rate
from eigenfail.values.campaign import Campaign, CampaignState, Counts
from eigenfail.values.campaign_spec import CampaignSpec, StopRules
from eigenfail.values.disturbance import NoiseTrajectory
from eigenfail.values.episode import EpisodeResult, Outcome
from eigenfail.values.estimates import Interval, Rate, RateDesign
from eigenfail.values.learning import LearnerContext
from eigenfail_services.analysis.sampling_design import SamplingDesign, find_end
from eigenfail_services.campaigns.rounds import Rounds
from eigenfail_services.methods.monte_carlo import MonteCarlo
from eigenfail_services.statistics.intervals import confidence_sequence, rate
from eigenfail_services.statistics.stopped_trials import StoppedTrials

BUDGET, SIZE = 65, 10
NOTHING = NoiseTrajectory(np.zeros((1, 2), np.float32), np.zeros((1, 2), np.float32))


def make_campaign(counts: Counts, rules: StopRules, because: str = "", **changes) -> Campaign:
    fields = {"name": "n", "method": "monte_carlo", "settings": {"round_size": SIZE}}
    spec = CampaignSpec(**fields | {"episodes": counts.planned, "stop": rules} | changes)
    done = CampaignState.DONE
    return Campaign(
        id=1, spec=spec, state=done, counts=counts, created_ms=1, stopped_because=because
    )


def run_campaign(failed: np.ndarray, rules: StopRules) -> Campaign:
    """Return a campaign whose episodes failed as given, ended by its rules or its budget."""
    context = LearnerContext(
        horizon=1, episodes=BUDGET, seed=0, trajectories=np.zeros((0, 1, 2), np.float32)
    )
    rounds = Rounds(MonteCarlo(context, MonteCarlo.Settings(round_size=SIZE)), 0, BUDGET, rules)
    run = 0
    while opened := rounds.open():
        tasks = opened[0].tasks
        run += len(tasks)
        rounds.complete(
            [
                EpisodeResult(
                    task.index,
                    task.seed,
                    Outcome.COLLISION if failed[task.index] else Outcome.SAFE,
                    1,
                    NOTHING,
                    "prior",
                )
                for task in tasks
            ]
        )
    counts = Counts(BUDGET, completed=run, failures=int(failed[:run].sum()))
    return make_campaign(counts, rules, rounds.stopped_because)


def estimate(campaign: Campaign) -> Rate:
    counts = campaign.counts
    return SamplingDesign.of_failures([campaign]).make_rate(counts.failures, counts.completed)


@pytest.mark.parametrize("p", [0.3, 0.05])
def test_campaigns_that_end_at_their_failures_estimate_without_bias(p: float) -> None:
    draws, rules = np.random.default_rng(3).random((2000, BUDGET)) < p, StopRules(failures=3)
    rates = [estimate(run_campaign(failed, rules)) for failed in draws]
    assert {found.design for found in rates} == {RateDesign.FAILURES}
    assert len({found.n for found in rates}) > 1
    values = np.array([found.value or 0.0 for found in rates])
    assert values.mean() == pytest.approx(p, abs=3.0 * values.std() / 2000**0.5)
    held = np.mean([found.interval.low <= p <= found.interval.high for found in rates])
    assert held >= 0.95 - 3.0 * (0.05 * 0.95 / 2000) ** 0.5


def test_the_looks_of_a_campaign_are_found_again() -> None:
    rules = StopRules(failures=3)

    def end_with(*failures: int) -> StoppedTrials | None:
        failed = np.isin(np.arange(BUDGET), failures)
        return find_end(run_campaign(failed, rules))

    assert end_with(0, 1, 2) == StoppedTrials(3, 0, 10, 10)
    assert end_with(0, 1, 25) == StoppedTrials(3, 20, 10, 10)
    assert end_with(0, 1, 45) == StoppedTrials(3, 40, 10, 10)
    # The round of 5 is open by now, so that the budget is spent whatever is seen.
    assert end_with(0, 1, 55) == StoppedTrials(3, 50, 0, 15)
    # The rule never held.
    assert end_with(0, 64) == StoppedTrials(3, 0, 0, 65)


@pytest.mark.parametrize(
    ("counts", "rules", "because"),
    [
        (Counts(100, completed=40, failures=3), StopRules(failures=3, half_width=0.1), ""),
        (Counts(100, completed=39, failures=3, errored=1), StopRules(failures=3), ""),
        (Counts(100, completed=40, failures=3), StopRules(failures=3), ""),
    ],
    ids=["two rules", "errored", "the open round has not ended"],
)
def test_an_end_that_is_not_known_exactly_has_a_confidence_sequence(counts, rules, because) -> None:
    campaign = make_campaign(counts, rules, because)
    found = estimate(campaign)
    assert find_end(campaign) is None
    assert (found.value, found.design) == (found.share, RateDesign.SEQUENCE)
    assert found.interval == confidence_sequence(found.k, found.n)


def test_the_rule_half_width_has_the_interval_that_it_judges() -> None:
    failed = np.random.default_rng(1).random(BUDGET) < 0.3
    campaign = run_campaign(failed, StopRules(half_width=0.24))
    found = estimate(campaign)
    assert campaign.counts.completed < BUDGET
    assert found.interval.high - found.interval.low <= 2 * 0.24
    assert "rule: half_width = 0.24" in campaign.stopped_because


def test_campaigns_together_and_other_events_have_a_confidence_sequence() -> None:
    one = make_campaign(Counts(65, completed=65, failures=2), StopRules(failures=3))
    other = make_campaign(Counts(65, completed=65, failures=2), StopRules())
    for design in (SamplingDesign.of_failures([one, other]), SamplingDesign.of([one.spec])):
        assert design.make_rate(4, 130).design is RateDesign.SEQUENCE
        assert design.find_bounds(design.make_rate(4, 130)) == confidence_sequence(4, 130)
    assert SamplingDesign.of([other.spec]).make_rate(4, 130) == rate(4, 130)


def test_one_sided_bounds_are_those_of_a_fixed_number() -> None:
    campaign = make_campaign(Counts(100, completed=100), StopRules(failures=3))
    assert estimate(campaign) == replace(rate(0, 100), design=RateDesign.FAILURES)
    assert explain_design(estimate(campaign)) == ""


def test_the_words_say_which_estimator_it_is() -> None:
    assert explain_design(rate(3, 40)) == ""
    known = Rate(0.2, 3, 12, Interval(0.1, 0.4), design=RateDesign.FAILURES)
    assert "the estimate without bias for this rule" in explain_design(known)
    assert format_rate(known) == "20.0 % [10.0, 40.0]"
    unknown = replace(known, value=None)
    assert "by its interval alone" in explain_design(unknown)
    assert format_rate(unknown) == "[10.0, 40.0] %"
    assert "a confidence sequence" in explain_design(replace(known, design=RateDesign.SEQUENCE))
