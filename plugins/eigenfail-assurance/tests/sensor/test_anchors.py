"""Bounds against scipy and the services' own intervals; errors of channels; what is refused."""

from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace
from scipy.special import betaincinv

from eigenfail.errors import InvalidValue, ServiceError, UnknownName
from eigenfail.intervals import ERROR, find_lower_bound, find_upper_bound
from eigenfail.values.campaign import Campaign, CampaignState, Counts
from eigenfail.values.campaign_spec import CampaignSpec, StopRules
from eigenfail.values.channels import Channel
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.estimates import Estimate, Interval
from eigenfail.values.shapes import Markov
from eigenfail.values.summary import Unresolved
from eigenfail_assurance.sensor import anchors
from eigenfail_assurance.sensor.scaling import describe_size, scale_model
from eigenfail_assurance.sensor.search import AnchorVerdict, MultipleRange, RequirementQuestion
from eigenfail_services.statistics.intervals import clopper_pearson, log_normal, rate

QUESTION = RequirementQuestion(target=0.01)


@given(n=st.integers(1, 3_000), share=st.floats(0.0, 1.0), error=st.floats(1e-4, 0.2))
def test_the_bounds_of_draws_from_p_are_exact(n, share, error):
    k = round(share * n)
    low = float(betaincinv(k, n - k + 1, error)) if k else 0.0
    high = float(betaincinv(k + 1, n - k, 1.0 - error)) if k < n else 1.0
    assert find_lower_bound(k, n, error) == pytest.approx(low, rel=1e-6, abs=1e-12)
    assert find_upper_bound(k, n, error) == pytest.approx(high, rel=1e-6, abs=1e-12)


@given(st.floats(1e-5, 0.5), st.integers(1, 5_000))
def test_the_fewest_failures_are_where_the_exact_interval_leaves_the_target(target, episodes):
    fewest = anchors.find_fewest_failures(target, episodes, ERROR / 2.0)
    if fewest is None:
        assert clopper_pearson(episodes, episodes).low <= target * (1.0 + 1e-9)
        return
    assert clopper_pearson(fewest, episodes).low > target * (1.0 - 1e-9)
    assert clopper_pearson(fewest - 1, episodes).low <= target * (1.0 + 1e-9)


@given(
    probability=st.floats(1e-9, 1e-2),
    cv=st.floats(0.01, 2.0),
    effective=st.floats(1.0, 1e4) | st.just(float("inf")),
)
def test_the_interval_of_an_estimate_is_found_again_at_its_own_confidence(
    probability, cv, effective
):
    interval = log_normal(probability, cv, effective)
    estimate = Estimate(
        by="subset simulation", episodes=9, probability=probability, cv=cv, interval=interval
    )
    again = anchors.bound_estimate(estimate, ERROR / 2.0)
    assert again.low == pytest.approx(interval.low, rel=1e-4)
    assert again.high == pytest.approx(interval.high, rel=1e-4)
    wider = anchors.bound_estimate(estimate, ERROR / 20.0)
    assert wider.low < again.low <= again.high <= wider.high


def make_campaign(counts, limit=None, method="monte_carlo", estimate=None, state="done"):
    spec = CampaignSpec(name="n", method=method, episodes=1000, stop=StopRules(failures=limit))
    return Campaign(
        id=3,
        spec=spec,
        state=CampaignState(state),
        counts=counts,
        created_ms=1,
        estimate=estimate,
    )


def test_a_campaign_that_its_failures_ended_has_a_lower_bound_of_its_whole_budget():
    limit = anchors.find_fewest_failures(0.01, 1000, 0.01)
    bounds = anchors.bound_sampled(make_campaign(Counts(1000, 200, limit + 3), limit), 0.01)
    assert bounds == Interval(find_lower_bound(limit, 1000, 0.01), 1.0)
    assert bounds.low > 0.01
    ended = anchors.bound_sampled(make_campaign(Counts(1000, 1000, limit - 1), limit), 0.01)
    assert ended.high < 1.0


def test_errored_episodes_count_against_the_target():
    bounds = anchors.bound_sampled(make_campaign(Counts(1000, 980, 1, errored=20)), 0.01)
    assert bounds.low == find_lower_bound(1, 1000, 0.01)
    assert bounds.high == find_upper_bound(21, 1000, 0.01)


def read(campaign, ended=None):
    found = rate(campaign.counts.failures, 1000)
    summary = SimpleNamespace(failure_rate=found, unresolved=ended or Unresolved())
    client = SimpleNamespace(campaigns=SimpleNamespace(summary=lambda _id: summary))
    return anchors.read_anchor(client, campaign, {"scale": 1.5}, 0.01, 0.01)


def test_unresolved_episodes_count_against_the_target():
    campaign = make_campaign(Counts(1000, 1000, 1))
    assert read(campaign).bounds == anchors.bound_sampled(campaign, 0.01)
    anchor = read(campaign, Unresolved(count=15, horizon_s=18.0))
    assert anchor.bounds.low == find_lower_bound(1, 1000, 0.01)
    assert anchor.bounds.high == find_upper_bound(16, 1000, 0.01)
    assert (read(campaign).verdict, anchor.verdict) == (
        AnchorVerdict.MET,
        AnchorVerdict.UNDECIDED,
    )
    # No more can have failed than there were.
    assert read(campaign, Unresolved(count=1000)).bounds.high == 1.0


def estimate_of(**given):
    return Estimate(**{"by": "subset simulation", "episodes": 1000, **given})


@pytest.mark.parametrize(
    ("campaign", "verdict"),
    [
        (make_campaign(Counts(1000, 1000, 0)), AnchorVerdict.MET),
        (make_campaign(Counts(1000, 1000, 8)), AnchorVerdict.UNDECIDED),
        (make_campaign(Counts(1000, 1000, 30)), AnchorVerdict.NOT_MET),
        (
            make_campaign(
                Counts(1000, 1000, 30),
                method="subset",
                estimate=estimate_of(probability=1e-3, cv=0.2, interval=log_normal(1e-3, 0.2, 40)),
            ),
            AnchorVerdict.MET,
        ),
        (
            make_campaign(
                Counts(1000, 1000, 30),
                method="subset",
                estimate=estimate_of(probability=9e-3, cv=0.2, interval=log_normal(9e-3, 0.2, 40)),
            ),
            AnchorVerdict.UNDECIDED,
        ),
        (
            make_campaign(
                Counts(1000, 1000), method="subset", estimate=estimate_of(problem="None was found.")
            ),
            AnchorVerdict.UNKNOWN,
        ),
        (make_campaign(Counts(1000, 1000), method="mixture"), AnchorVerdict.UNKNOWN),
    ],
)
def test_what_a_campaign_shows_follows_from_its_bounds(campaign, verdict):
    anchor = read(campaign)
    assert anchor.verdict is verdict
    assert bool(anchor.problem) is (verdict is AnchorVerdict.UNKNOWN)


@pytest.mark.parametrize(
    "campaign",
    [
        make_campaign(Counts(1000, 0, errored=1000)),
        make_campaign(Counts(1000, 500), state="cancelled"),
    ],
)
def test_a_campaign_that_came_to_nothing_says_nothing(campaign):
    with pytest.raises(ServiceError, match=r"Campaign 3 is .*it bounds no probability"):
        read(campaign)


CHANNELS = (
    Channel("longitudinal"),
    Channel("every.speed", sigma=0.3),
    Channel("missed", shape=Markov(rate=0.02)),
    Channel("delay"),
    Channel("scenario.distance_m"),
)
NAMED = DisturbanceModel(channels=CHANNELS, scale=2.0)


def test_a_multiple_scales_the_channel_and_nothing_else():
    scaled = scale_model(NAMED, {"longitudinal": 1.5, "missed": 2.0, "every.speed": 0.5})
    was = NAMED.list_channels()
    assert scaled.list_channels() == (
        replace(was[0], sigma=1.5, sigma_per_m=0.03),
        replace(was[1], sigma=0.15),
        replace(was[2], shape=Markov(rate=0.04)),
        *was[3:],
    )
    assert scaled.scale == 2.0
    position = scale_model(DisturbanceModel(), {"lateral": 3.0, "scale": 0.5})
    assert position == DisturbanceModel(
        lateral_base_m=0.2 * 3.0, lateral_slope=0.00625 * 3.0, scale=0.5
    )


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("longitudinal", "longitudinal sigma up to {} × (2 m + 0.04·d)"),
        ("every.speed", "every.speed sigma up to {} × 0.6 m/s"),
        ("missed", "missed rate up to {} × 0.02 a step"),
        ("delay", "delay sigma up to {} × 0.2 s"),
        ("scale", "every sigma up to {} × its own"),
    ],
)
def test_the_size_of_an_error_is_in_its_unit(name, words):
    assert describe_size(NAMED, name) == words


def make_spec(**given):
    return CampaignSpec(**{"name": "n", "method": "monte_carlo", "episodes": 1000, **given})


@pytest.mark.parametrize(
    ("error", "field", "words", "spec", "question"),
    [
        (
            UnknownName,
            "channels",
            "'latral'.*Did you mean 'lateral'",
            {},
            {"channels": ("latral",)},
        ),
        (UnknownName, "channels", "'missed'", {}, {"channels": ("missed",)}),
        (InvalidValue, "channels", "names no channel", {}, {"channels": ()}),
        (InvalidValue, "channels", "there twice", {}, {"channels": ("scale", "scale")}),
        (
            InvalidValue,
            "channels",
            "neither a sigma nor a rate",
            {"disturbance": NAMED},
            {"channels": ("scenario.distance_m",)},
        ),
        (
            UnknownName,
            "channels",
            "'lateral'",
            {"simulator": "function", "scenario": "function", "planner": "m:f"},
            {"channels": ("lateral",)},
        ),
        (InvalidValue, "method", "'cem' gives no estimate.*Take subset", {"method": "cem"}, {}),
        (UnknownName, "method", "'subst'.*Did you mean 'subset'", {"method": "subst"}, {}),
        (InvalidValue, "episodes", "491 cannot show.*Give 492 or more", {"episodes": 491}, {}),
        (InvalidValue, "stop.failures", "Remove", {"stop": StopRules(failures=3)}, {}),
        (
            InvalidValue,
            "high",
            "30 × missed: .*Search lower",
            {"disturbance": NAMED},
            {"channels": ("missed",), "within": MultipleRange(1.0, 30.0, 0.5)},
        ),
    ],
)
def test_what_cannot_be_answered_is_refused_by_field(error, field, words, spec, question):
    asked = RequirementQuestion(**{"target": 0.01, **question})
    with pytest.raises(error, match=words) as refused:
        anchors.check_question(make_spec(**spec), asked)
    assert refused.value.field == field


def test_as_many_episodes_as_show_the_target_are_enough():
    fewest = 492
    assert find_upper_bound(0, fewest, QUESTION.test_error) <= QUESTION.target
    assert find_upper_bound(0, fewest - 1, QUESTION.test_error) > QUESTION.target
    anchors.check_question(make_spec(episodes=fewest), QUESTION)


def test_equal_anchors_are_equal_campaigns():
    spec = make_spec(disturbance=NAMED, stop=StopRules(wall_s=9.0))
    one, other = (
        anchors.make_anchor_suite(spec, {"missed": 1.5, "scale": 1.0}, 0.01, 0.01) for _ in "12"
    )
    assert one == other
    (member,) = one.members
    assert member.spec.name == "sensor of n: missed × 1.5, scale × 1"
    assert member.spec.stop == StopRules(
        wall_s=9.0, failures=anchors.find_fewest_failures(0.01, 1000, 0.01)
    )
    subset = anchors.make_anchor_suite(make_spec(method="subset"), {"scale": 1.5}, 0.01, 0.01)
    assert subset.members[0].spec.stop == StopRules()


def test_the_anchors_are_campaigns_of_the_service():
    asked = []

    def run(suite):
        asked.append(suite.members[0].spec.disturbance.scale)
        return make_campaign(Counts(1000, 1000, 40 * (asked[-1] > 1.3)))

    summary = SimpleNamespace(failure_rate=rate(1, 1000), unresolved=Unresolved())
    client = SimpleNamespace(campaigns=SimpleNamespace(summary=lambda _id: summary))
    answer = anchors.find_sensor_requirement(client, make_spec(), QUESTION, run)
    assert asked[:2] == [0.5, 2.0]
    assert answer.limits[0].largest == max(scale for scale in asked if scale <= 1.3)
    assert answer.limits[0].largest > 1.2
