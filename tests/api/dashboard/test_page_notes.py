"""Sentences and tiles of pages, from values that are known."""

import pytest

from eigenfail.values.access import Quotas, Usage
from eigenfail.values.campaign import Campaign, CampaignState, Counts
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.summary import MeanTime
from eigenfail_api.dashboard.campaign_page import make_mean_tile
from eigenfail_api.dashboard.cost_charts import describe_omitted
from eigenfail_api.dashboard.keys_page import list_quotas
from eigenfail_api.dashboard.launch_fields import describe_bounds
from eigenfail_api.dashboard.measures_page import describe_basis


def campaign(state):
    spec = CampaignSpec(name="first", method="ast", episodes=10)
    return Campaign(id=1, spec=spec, state=state, counts=Counts(planned=10), created_ms=0)


@pytest.mark.parametrize(
    ("state", "completed", "billed", "words"),
    [
        ("running", 0, 0, "Safety measures and cost appear after the first episode."),
        ("done", 0, 0, "No episode was completed: there are no safety measures, and no failure "),
        ("running", 1, 1, "As of 1 completed episode; updated less often than the figures above."),
        ("running", 1200, 900, "As of 1,200 completed episodes; cost as of 900; updated less"),
        ("done", 1200, 1200, "Over all completed episodes: 1,200."),
    ],
)
def test_measures_say_which_episodes_they_rest_on(state, completed, billed, words):
    assert describe_basis(campaign(CampaignState(state)), completed, billed).startswith(words)


def test_tiles_without_a_value_say_why():
    assert make_mean_tile(MeanTime(None, 0)).notes == ("no such collision",)
    known = make_mean_tile(MeanTime(1.234, 1200))
    assert (known.value, known.notes) == ("1.23 s", ("mean of 1,200",))


def test_quotas_are_listed_with_what_is_used_of_them():
    used = Usage(open=2, episodes_of_day=1500)
    everything = Quotas(max_open=3, max_episodes=20_000, max_episodes_per_day=50_000)
    assert list(list_quotas(everything, used)) == [
        "2 of 3 campaigns open",
        "20,000 episodes per campaign",
        "1,500 of 50,000 episodes in 24 h",
    ]
    assert list(list_quotas(Quotas(max_open=None, max_episodes=5), used)) == [
        "5 episodes per campaign"
    ]


def test_groups_that_a_chart_leaves_out_are_counted():
    assert describe_omitted(0) == ()
    assert describe_omitted(1) == ("1 older group of campaigns not shown; see /api/v1/costs.",)
    assert describe_omitted(4)[0].startswith("4 older groups of campaigns")


@pytest.mark.parametrize(
    ("part", "kind", "words"),
    [
        (
            {"items": {"enum": ["a", "b"]}},
            "list",
            "separated by commas: a, b",
        ),
        ({"items": {"type": "string"}}, "list", "separated by commas"),
        ({}, "table", 'JSON, such as {"alpha": 100}'),
        (
            {"type": "integer", "minimum": 1, "maximum": 9},
            "number",
            "whole, at least 1, at most 9",
        ),
        (
            {"type": "number", "exclusiveMinimum": 0, "exclusiveMaximum": 1},
            "number",
            "above 0, below 1",
        ),
    ],
)
def test_the_accepted_values_of_a_field_are_told(part, kind, words):
    assert describe_bounds(part, kind, {}) == words
