"""The row of a campaign in a result table."""

import msgspec
import pytest
from made_campaigns import make_campaign
from msgspec.structs import replace

from eigenfail.presentation.tables import format_cell
from eigenfail.values.campaign import Campaign, CampaignState, Counts, EpisodeForm
from eigenfail.values.campaign_spec import StopRules
from eigenfail.values.estimates import Estimate, Rate, RateDesign
from eigenfail.values.records import ConflictTotals, Totals
from eigenfail.values.summary import Conflicts, MeanTime, Unresolved
from eigenfail_services.analysis.campaign_figures import price_failures
from eigenfail_services.campaigns.summary import summarise
from eigenfail_services.statistics.intervals import clopper_pearson, confidence_sequence, rate

NOTHING = Totals(failures=0, log_probability=0.0, steps=0, severity=0.0)


def campaign(counts: Counts, active_s: float = 0.0, method: str = "monte_carlo") -> Campaign:
    price = {"price_usd_per_hour": 1.8, "instances": 2}
    fields = {"spec": price, "active_s": active_s, "form": EpisodeForm(100, 0.1)}
    return make_campaign(counts, method, CampaignState.RUNNING, **fields)


HOURS = 2 * 40.0 / 3600.0
"""Of the two instances of `campaign`, active for 40 s."""


COLLIDED = ConflictTotals(planner_failures=4)


def test_a_campaign_with_failures() -> None:
    counts = Counts(planned=100, completed=80, failures=4, errored=2)
    row = summarise(campaign(counts, active_s=40.0), Totals(4, -600.0, 240, 500.0, COLLIDED))
    assert (row.campaign, row.name, row.method, row.counts) == (7, "truck", "monte_carlo", counts)
    assert row.failure_rate == rate(4, 80, errored=2)
    assert row.mean_log_probability == -150.0
    assert row.log_probability_per_step == -2.5
    assert row.mean_severity == 125.0
    assert row.episodes_per_s == 2.0
    assert row.cost == price_failures(1.8 * HOURS, HOURS, rate(4, 80, errored=2))
    assert row.cost.total_usd == pytest.approx(0.04)


def test_a_campaign_without_a_failure_has_no_means_but_a_price() -> None:
    row = summarise(campaign(Counts(planned=100, completed=80), active_s=40.0), NOTHING)
    assert row.mean_log_probability is row.log_probability_per_step is row.mean_severity is None
    assert row.failure_rate == rate(0, 80)
    assert row.cost.at_least_usd == pytest.approx(0.04 / (80 * row.failure_rate.interval.high))


@pytest.mark.parametrize(
    ("method", "failures", "noted"),
    [
        ("monte_carlo", 4, True),
        ("monte_carlo", 3, True),
        ("monte_carlo", 0, False),
        ("ast", 4, False),
    ],
)
def test_a_rate_that_its_failures_may_have_ended_says_so(method, failures, noted) -> None:
    one = campaign(Counts(planned=100, completed=80, failures=failures), 40.0, method)
    one = msgspec.structs.replace(
        one, spec=msgspec.structs.replace(one.spec, stop=StopRules(failures=4))
    )
    row = summarise(one, NOTHING)
    assert row.failure_rate is not None
    counted = rate(failures, 80)
    if failures == 4 and noted:  # the campaign goes on until its open round has ended
        sequence = confidence_sequence(failures, 80)
        counted = replace(counted, interval=sequence, design=RateDesign.SEQUENCE)
    elif noted:
        exact = clopper_pearson(failures, 80)
        counted = replace(counted, interval=exact, design=RateDesign.FAILURES)
    elif method == "monte_carlo":
        counted = replace(counted, design=RateDesign.FAILURES)
    else:
        counted = replace(counted, interval=None, sampled=False)
    assert row.failure_rate == counted
    assert (" rule " in row.remark) == noted
    assert row.cost == price_failures(1.8 * HOURS, HOURS, row.failure_rate)


@pytest.mark.parametrize("failures", [0, 4])
def test_the_share_of_a_search_has_no_interval_and_its_cost_neither(failures) -> None:
    counts = Counts(planned=100, completed=80, failures=failures)
    row = summarise(campaign(counts, active_s=40.0, method="ast"), NOTHING)
    assert row.failure_rate == Rate(failures / 80, failures, 80, None, sampled=False)
    assert row.cost.per_failure_usd == (0.01 if failures else None)
    assert row.cost.interval_usd is row.cost.at_least_usd is None


def test_a_campaign_that_has_not_begun_has_neither_rate_nor_speed() -> None:
    row = summarise(campaign(Counts(planned=100)), NOTHING)
    assert row.failure_rate is row.episodes_per_s is row.cost.at_least_usd is None
    assert row.cost.total_usd == 0.0


def test_only_completed_episodes_are_its_speed() -> None:
    row = summarise(campaign(Counts(planned=100, errored=50), active_s=10.0), NOTHING)
    assert row.episodes_per_s == 0.0
    assert row.failure_rate is None


def test_conflicts_as_the_paper_counts_them() -> None:
    # The paper's 300 episodes of DiFS: nine collisions, seen 2.24 s and 0.23 s ahead on average.
    found = ConflictTotals(
        unavoidable=4,
        planner_failures=5,
        near_misses=10,
        ttc_lead_s=20.16,
        ttc_leads=9,
        drac_lead_s=0.92,
        drac_leads=4,
    )
    totals = Totals(9, -1491.0 * 9, 7200, 1035.0, found)
    row = summarise(campaign(Counts(300, completed=300, failures=9)), totals)
    leads = MeanTime(pytest.approx(2.24), 9), MeanTime(pytest.approx(0.23), 4)
    assert row.conflicts == Conflicts(4, 5, 0, 10, *leads)


def test_the_learners_estimate_is_the_summarys() -> None:
    told = Estimate(by="subset simulation", episodes=7, problem="Not known yet.")
    with_estimate = replace(campaign(Counts(10)), estimate=told)
    assert summarise(with_estimate, NOTHING).estimate == told
    assert summarise(with_estimate, NOTHING).remark == "No failure probability: Not known yet."
    assert summarise(with_estimate, NOTHING).rate_remark == ""
    assert summarise(campaign(Counts(10)), NOTHING).estimate is None


def test_lead_times_of_nothing_are_unknown() -> None:
    assert summarise(campaign(Counts(10)), NOTHING).conflicts == Conflicts()


def test_what_ended_too_early_to_tell_stands_beside_the_rate() -> None:
    found = ConflictTotals(unresolved=5)
    row = summarise(campaign(Counts(300, completed=300)), Totals(0, 0.0, 0, None, found))
    assert row.failure_rate == rate(0, 300, unresolved=5)
    assert row.unresolved == Unresolved(5, 10.0)
    assert row.remark == (
        "5 of 300 had no collision within 10 s, but ended while braking could not avoid one any "
        "more. Upper bounds count such episodes as failures."
    )
    assert summarise(campaign(Counts(300, completed=300)), NOTHING).remark == ""


def test_errored_episodes_count_as_failures_in_the_upper_bound() -> None:
    """54 of 200 episodes errored: were they failures, P might be 32.6 %, not 2 %."""
    row = summarise(campaign(Counts(200, completed=146, errored=54), active_s=40.0), NOTHING)
    found = row.failure_rate
    assert (found.k, found.n, found.trials) == (0, 146, 200)
    assert found.interval.high == pytest.approx(0.3265, abs=1e-4)
    assert format_cell(found).value == "≤ 32.7 %"
    assert format_cell(found).sample == "0 of 146, 54 errored"
    assert row.cost.at_least_usd == pytest.approx(0.04 / (200 * found.interval.high))


def ended(counts: Counts, **spec: object) -> Campaign:
    found = campaign(counts)
    return replace(found, state=CampaignState.DONE, spec=replace(found.spec, **spec))


def test_a_method_that_found_nothing_says_where_its_reach_ends() -> None:
    none = Counts(planned=100, completed=100)
    assert summarise(ended(none, method="ast"), NOTHING).remark == (
        "No failure was found. The method explores disturbances of at most 2 sigma, held for 10 "
        "steps, and of up to 4 sigma in restarts after every 100 episodes with next to no failure, "
        "where as many are left; failures beyond are out of its reach. Raise `amplitude`, or run "
        "cem, difs or subset."
    )
    settings = {
        "method": "ast",
        "members": 2,
        "settings": {"amplitude": 1.5, "hold": 1, "patience": None},
    }
    ensemble = summarise(ended(none, method="ensemble", settings=settings), NOTHING)
    assert "disturbances of at most 1.5 sigma; failures" in ensemble.remark


@pytest.mark.parametrize("method", ["cem", "monte_carlo", "a_method_that_was_uninstalled"])
def test_a_method_without_a_bounded_reach_says_nothing_of_one(method: str) -> None:
    assert summarise(ended(Counts(100, completed=100), method=method), NOTHING).reach == ""


def test_reach_is_told_only_of_campaigns_that_ended_without_a_failure() -> None:
    assert summarise(campaign(Counts(100, completed=80), method="ast"), NOTHING).reach == ""
    assert summarise(ended(Counts(100, errored=100), method="ast"), NOTHING).reach == ""
    found = Totals(4, -600.0, 240, 500.0)
    assert summarise(ended(Counts(100, completed=80, failures=4), method="ast"), found).reach == ""
