"""Sentences and tiles of pages, from values that are known."""

from eigenfail.values.access import Quotas, Usage
from eigenfail.values.summary import MeanTime
from eigenfail_api.dashboard.campaign_page import make_mean_tile
from eigenfail_api.dashboard.cost_charts import describe_omitted_groups
from eigenfail_api.dashboard.keys_page import list_quotas


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
    assert describe_omitted_groups(0) == ()
    assert describe_omitted_groups(1) == (
        "1 older group of campaigns not shown; see /api/v1/costs.",
    )
    assert describe_omitted_groups(4)[0].startswith("4 older groups of campaigns")
