"""The failure probability in tables: told with what it rests on, or why it is not told."""

import io

import msgspec
import pytest
from rich.console import Console

from eigenfail.presentation.campaigns import (
    list_campaign_facts,
    tabulate_campaigns,
    tabulate_results,
)
from eigenfail.presentation.suites import MemberResult, SuiteResult, describe_suite_result
from eigenfail.presentation.terminal import render
from eigenfail.values.campaign import Campaign, CampaignState, Counts
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.estimates import Cost, Estimate, Interval
from eigenfail.values.summary import Summary

TOLD = Estimate(
    by="subset simulation",
    episodes=9100,
    probability=3.7e-6,
    cv=0.25,
    interval=Interval(2.2e-6, 5.9e-6),
    note="It knows nothing of the rest.",
)
BOUND = Estimate(
    by="importance sampling",
    episodes=9100,
    probability=3.7e-6,
    cv=0.04,
    note="Other regions are missed.",
    bound="lower",
)
REFUSED = Estimate(by="importance sampling", episodes=500, effective=4.0, problem="Too few count.")


def campaign(estimate=None):
    spec = CampaignSpec(name="rare", method="subset", episodes=10_000)
    counts = Counts(10_000, completed=9100, failures=900)
    return Campaign(
        id=3, spec=spec, state=CampaignState.DONE, counts=counts, created_ms=0, estimate=estimate
    )


def summary(estimate=None):
    counts = campaign().counts
    price = Cost(1.0, 1.0, None, None, None)
    return Summary(3, "rare", "subset", counts, None, None, None, None, None, price, None, estimate)


def text(table):
    console = Console(file=io.StringIO(), width=250)
    console.print(render(table))
    return console.file.getvalue()


@pytest.mark.parametrize("tables", [(tabulate_campaigns, campaign), (tabulate_results, summary)])
def test_a_column_of_probabilities_appears_where_one_is_told(tables):
    tabulate, row = tables
    shown = text(tabulate([row(TOLD), row(REFUSED), row()]))
    assert shown.count("3.70×10⁻⁶ [2.20×10⁻⁶, 5.90×10⁻⁶] (n = 9,100)") == 1
    assert "P(failure) [95 %]" in shown
    assert "P(failure)" not in text(tabulate([row(), row()]))


def test_a_suites_table_has_that_column_where_a_member_tells_one():
    def suite(*estimates):
        members = [
            MemberResult(f"m{place}", CampaignState.DONE, "", summary(estimate))
            for place, estimate in enumerate(estimates)
        ]
        return SuiteResult("s", 3, (*members, MemberResult("missing")))

    lines = text(*describe_suite_result(suite(None, TOLD, REFUSED))).splitlines()
    assert lines[0].rstrip().endswith("P(failure) [95 %]")
    assert [line.rstrip().endswith("(n = 9,100)") for line in lines[2:6]] == [
        False,
        True,
        False,
        False,
    ]
    assert "P(failure)" not in text(*describe_suite_result(suite(None)))


def test_a_campaigns_facts_say_what_the_probability_rests_on():
    shown = text(list_campaign_facts(campaign(TOLD)))
    assert "3.70×10⁻⁶ [2.20×10⁻⁶, 5.90×10⁻⁶] (n = 9,100), subset simulation, cv 0.250" in shown
    assert "It knows nothing of the rest." in shown


@pytest.mark.parametrize("tables", [(tabulate_campaigns, campaign), (tabulate_results, summary)])
def test_a_lower_bound_stands_in_the_tables_without_an_interval(tables):
    tabulate, row = tables
    shown = text(tabulate([row(BOUND), row(BOUND)]))
    assert shown.count("at least 3.70×10⁻⁶ (n = 9,100)") == 2


def test_a_result_table_says_once_why_probabilities_are_lower_bounds():
    assert text(tabulate_results([summary(BOUND), summary(BOUND)])).count(BOUND.note) == 1
    assert "At least:" not in text(tabulate_results([summary(TOLD)]))


def test_a_result_table_says_why_there_is_no_probability():
    missing = "Campaign 3: No failure probability: Too few count."
    assert missing in text(tabulate_results([summary(REFUSED)]))
    assert missing in text(*describe_suite_result(SuiteResult("s", 3, (member(REFUSED),)))[:1])
    assert "No failure probability" not in text(tabulate_results([summary(TOLD), summary(BOUND)]))


def member(estimate):
    return MemberResult("m", CampaignState.DONE, "", summary(estimate))


def test_a_campaigns_facts_tell_a_lower_bound_with_its_reason():
    shown = text(list_campaign_facts(campaign(BOUND)))
    assert "at least 3.70×10⁻⁶ (n = 9,100), importance sampling" in shown
    assert "cv" not in shown
    assert BOUND.note in shown


def test_a_campaigns_facts_say_how_many_episodes_were_trained_with():
    trained = msgspec.structs.replace(campaign(), trained_episodes=170)
    assert "trained with  170 episodes" in text(list_campaign_facts(trained))
    assert "trained with" not in text(list_campaign_facts(campaign()))


def test_a_campaigns_facts_say_why_there_is_no_probability():
    shown = text(list_campaign_facts(campaign(REFUSED)))
    assert "unknown, importance sampling" in shown
    assert "Too few count." in shown
    assert "P(failure)" not in text(list_campaign_facts(campaign()))
