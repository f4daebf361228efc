"""A suite as one table."""

import pytest
from accepted import accept_spec
from store_checks.examples import deliver, running

from eigenfail.errors import NotFound
from eigenfail.testing.examples import collision, result, spec
from eigenfail_services.comparison.seeds import make_suite_table


def settings(table):
    return {row.member: row.settings for row in table.members}


def test_columns_are_what_differs_and_nothing_else(store):
    drawn = {"lanes": {"uniform": [2, 4]}, "gap_m": 3.0}
    for name, changes in {
        "base": {},
        "alpha": {"settings": {"alpha": 5, "same": 1}},
        "drawn": {"scenario_parameters": drawn, "seed": 4},
    }.items():
        store.campaigns.create(accept_spec(spec(name=f"s: {name}", **changes)))
    table = make_suite_table(store, "s")
    assert table.columns == ("seed", "alpha", "same", "gap_m", "lanes")
    assert settings(table) == {
        "base": {"seed": 0},
        "alpha": {"seed": 0, "alpha": 5, "same": 1},
        "drawn": {"seed": 4, "lanes": {"uniform": [2, 4]}, "gap_m": 3.0},
    }


def test_settings_of_one_last_word_have_their_whole_path(store):
    for number in (1, 2):
        both = {"settings": {"rate": number}, "planner_settings": {"rate": -number}}
        store.campaigns.create(accept_spec(spec(name=f"s: {number}", **both)))
    assert make_suite_table(store, "s").columns == ("settings.rate", "planner_settings.rate")


def test_of_a_name_the_newest_campaign_counts_and_earlier_ones_are_told(store):
    for name, seed in (("a", 1), ("b", 1), ("a", 2)):
        store.campaigns.create(accept_spec(spec(name=f"s: {name}", seed=seed)))
    table = make_suite_table(store, "s")
    assert [(row.member, row.campaign) for row in table.members] == [("a", 3), ("b", 2)]
    assert (table.columns, table.earlier) == (("seed",), 1)


def test_a_row_sums_up_what_came_of_its_campaign(store):
    campaign = running(store, name="s: one")
    deliver(store, campaign, collision(0), result(1))
    (row,) = make_suite_table(store, "s").members
    assert (row.state, row.summary.failure_rate.k, row.summary.failure_rate.n) == ("running", 1, 2)
    assert row.settings == {}


def test_long_suites_are_read_whole_and_cut_at_the_oldest(store, monkeypatch):
    monkeypatch.setattr("eigenfail_services.store.campaigns.CAMPAIGNS_AT_A_TIME", 2)
    for name in range(5):
        store.campaigns.create(accept_spec(spec(name=f"s: {name}")))
    assert len(make_suite_table(store, "s").members) == 5
    cut = make_suite_table(store, "s", most=3)
    assert ([row.member for row in cut.members], cut.left_out) == (["2", "3", "4"], 2)


def test_a_suite_that_nobody_ran_is_not_found(store):
    store.campaigns.create(accept_spec(spec(name="alone")))
    with pytest.raises(NotFound, match="No campaign belongs to a suite 'alone'"):
        make_suite_table(store, "alone")
