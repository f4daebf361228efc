"""Which figures of campaigns state a probability of failure, and which do not."""

import pytest
from accepted import accept_spec
from msgspec.structs import replace

from eigenfail.errors import InvalidValue
from eigenfail.values.campaign import Campaign, CampaignState, Counts
from eigenfail.values.campaign_spec import CampaignSpec, StopRules
from eigenfail.values.estimates import Estimate, RateDesign
from eigenfail_assurance.risk.assessment import RiskVerdict
from eigenfail_assurance.risk.campaigns import assess_campaigns, find_probability
from eigenfail_assurance.risk.confidence import FailureShare, RunEstimate, Stated
from eigenfail_assurance.risk.question import Driving, RiskQuestion, RiskScenario, RiskTarget
from eigenfail_services.analysis.sampling_design import SamplingDesign
from eigenfail_services.campaigns.summary import find_failure_rate
from eigenfail_services.statistics.intervals import confidence_sequence, log_normal

SUBSET = Estimate(
    by="subset simulation", episodes=900, probability=1e-4, cv=0.3, interval=log_normal(1e-4, 0.3)
)


def make_campaign(method="monte_carlo", failures=3, errored=0, estimate=None, **fields):
    spec = CampaignSpec(name="x", method=method, episodes=1_000, **fields)
    done = 1_000 - errored
    counts = Counts(planned=1_000, completed=done, failures=failures, errored=errored)
    return Campaign(
        id=7,
        spec=spec,
        state=CampaignState.DONE,
        counts=counts,
        created_ms=0,
        estimate=estimate,
    )


def test_counts_of_monte_carlo_state_it():
    found = find_probability([make_campaign(errored=2)])
    assert found.known == FailureShare(3, 2, 1_000, 3 / 998)
    assert found.problem == ""


def test_unresolved_episodes_count_in_the_upper_bound_alone():
    (known, _) = find_probability([make_campaign(errored=2)], 5)
    (without, _) = find_probability([make_campaign(errored=2)])
    assert known == FailureShare(3, 2, 1_000, 3 / 998, 5)
    assert known.value == without.value
    assert (known.draw_lower() == without.draw_lower()).all()
    as_failures = FailureShare(10, 0, 1_000, 0.01)
    assert (known.draw_upper() == as_failures.draw_upper()).all()
    (stopped, _) = find_probability([make_campaign(stop=StopRules(half_width=0.5))], 5)
    assert stopped.low == confidence_sequence(3, 1_000).low
    assert stopped.high == confidence_sequence(8, 1_000).high
    together = [make_campaign(), make_campaign(failures=5, seed=2)]
    assert find_probability(together, 7).known == FailureShare(8, 0, 2_000, 8 / 2_000, 7)


def test_a_rule_that_ended_nothing_changes_nothing():
    found = find_probability([make_campaign(stop=StopRules(failures=10))])
    assert found.known == FailureShare(3, 0, 1_000, 0.003)


def test_a_rule_that_may_have_ended_it_gives_its_own_interval():
    (known, _) = find_probability([make_campaign(stop=StopRules(half_width=0.5))])
    assert isinstance(known, Stated)
    assert 0.0 < known.low < known.value < known.high


def test_errored_episodes_count_in_both_bounds_where_a_rule_applied():
    rules = StopRules(half_width=0.5)
    (known, _) = find_probability([make_campaign(stop=rules, failures=30, errored=20)])
    assert known.value == 30 / 980
    assert known.low == confidence_sequence(30, 1_000).low
    assert known.high == confidence_sequence(50, 1_000).high


def test_bounds_are_two_sided_where_a_rule_ended_it_with_failures_alone():
    campaign = make_campaign(stop=StopRules(failures=4))
    counts = Counts(planned=1_000, completed=100, failures=100)
    stopped = replace(campaign, counts=counts, stopped_because="Stopped (rule: failures = 4).")
    (known, _) = find_probability([stopped])
    one_sided = find_failure_rate(stopped, 0)
    assert one_sided.design is RateDesign.FAILURES
    assert known.low == SamplingDesign.of_failures([stopped]).find_bounds(one_sided).low
    assert known.low < one_sided.interval.low
    assert known.high == 1.0


def test_an_estimate_states_it_with_its_own_interval():
    (known, _) = find_probability([make_campaign("subset", 300, estimate=SUBSET)])
    assert isinstance(known, RunEstimate)
    assert (known.value, known.cv) == (1e-4, 0.3)


@pytest.mark.parametrize(
    ("method", "estimate", "because"),
    [
        ("ast", None, "is a search ('ast')"),
        # Even a full estimate of a method that does not claim to bound P(failure).
        ("cem", SUBSET, "is a search ('cem')"),
        ("replay", None, "is a search ('replay')"),
        ("chains", None, "is a search ('chains')"),
        ("no_such_plugin", SUBSET, "is a search"),
        ("subset", None, "it gave no estimate"),
        ("subset", Estimate(by="x", episodes=9, problem="The runs disagree."), "disagree"),
        ("mixture", replace(SUBSET, interval=None), "has no interval"),
        ("mixture", replace(SUBSET, bound="lower"), "has no interval"),
    ],
)
def test_what_states_nothing_is_told(method, estimate, because):
    found = find_probability([make_campaign(method, 900, estimate=estimate)])
    assert found.known is None
    assert because in found.problem


@pytest.mark.parametrize(
    "state", [state for state in CampaignState if state is not CampaignState.DONE]
)
def test_a_campaign_that_is_not_done_states_nothing(state):
    found = find_probability([replace(make_campaign(), state=state)])
    assert found.known is None
    assert f"campaign 7 is {state.value}" in found.problem


def test_a_campaign_without_a_completed_episode_states_nothing():
    found = find_probability([make_campaign(failures=0, errored=1_000)])
    assert found.known is None
    assert "campaign 7 is errored" in found.problem


def test_only_fixed_numbers_of_monte_carlo_are_counted_together():
    one, other = make_campaign(), make_campaign(failures=5, errored=1, seed=2)
    assert find_probability([one, other]).known == FailureShare(8, 1, 2_000, 8 / 1_999)
    stopped = make_campaign(stop=StopRules(failures=3), seed=2)
    for second in (stopped, make_campaign("subset", estimate=SUBSET)):
        assert "counted together only where" in find_probability([one, second]).problem


def ask(store, **fields):
    scenario = RiskScenario(**{"name": "a", "encounters": 3, **fields})
    question = RiskQuestion(
        name="q",
        target=RiskTarget(per_hour=1.0),
        exposure=Driving(hours=1.0),
        scenarios=(scenario,),
    )
    return assess_campaigns(store, question)


def test_a_queued_campaign_leaves_it_undecided(store):
    made = store.campaigns.create(
        accept_spec(CampaignSpec(name="x", method="monte_carlo", episodes=9))
    )
    found = ask(store, campaigns=(made.id,))
    assert found.verdict is RiskVerdict.UNDECIDED
    assert found.planner == "rulebook"
    assert "is queued, with 0 completed" in found.scenarios[0].problem


def test_the_same_noise_is_not_counted_twice(store):
    spec = CampaignSpec(name="x", method="monte_carlo", episodes=9, seed=4)
    ids = [store.campaigns.create(accept_spec(replace(spec, episodes=n))).id for n in (9, 10)]
    with pytest.raises(InvalidValue, match="the same seed") as caught:
        ask(store, campaigns=tuple(ids))
    assert "scenarios[0].campaigns" in str(caught.value)


def test_failures_are_those_of_the_same_scenario_and_no_search(store):
    spec = CampaignSpec(name="x", method="monte_carlo", episodes=9)
    one, merge, search = (
        store.campaigns.create(accept_spec(each)).id
        for each in (spec, replace(spec, scenario="merge_in"), replace(spec, method="cem"))
    )
    with pytest.raises(InvalidValue, match="another scenario than"):
        ask(store, campaigns=(one,), failures_from=merge)
    with pytest.raises(InvalidValue, match="no random sample"):
        ask(store, campaigns=(one,), failures_from=search)
    again = store.campaigns.create(accept_spec(replace(spec, seed=2))).id
    with pytest.raises(InvalidValue, match="is queued") as caught:
        ask(store, campaigns=(one,), failures_from=again)
    assert "scenarios[0].failures_from" in str(caught.value)
    assert "Name a campaign that has ended" in str(caught.value)


def test_the_campaign_of_the_severity_is_compared_as_well(store):
    spec = CampaignSpec(name="x", method="monte_carlo", episodes=9)
    noisier = replace(spec.disturbance, scale=2.0)
    one = store.campaigns.create(accept_spec(spec)).id
    other = store.campaigns.create(accept_spec(replace(spec, disturbance=noisier))).id
    for state in (CampaignState.RUNNING, CampaignState.DONE):
        store.campaigns.move(other, state)
    assert not any("disturbance" in note for note in ask(store, campaigns=(one,)).notes)
    notes = ask(store, campaigns=(one,), failures_from=other).notes
    assert "The campaigns do not have the same disturbance model." in notes


def test_a_name_that_others_contain_is_not_theirs(store):
    spec = CampaignSpec(name="cut", method="monte_carlo", episodes=9)
    wanted = store.campaigns.create(accept_spec(spec)).id
    store.campaigns.create(accept_spec(replace(spec, name="cut in")))
    assert ask(store, campaigns=("cut",)).scenarios[0].campaigns == (wanted,)
