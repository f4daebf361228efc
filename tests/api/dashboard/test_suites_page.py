"""Suites as pages: a list, and one table of what differs."""

import re
from types import SimpleNamespace

import pytest

from eigenfail.values.campaign import BUDGET_SPENT
from eigenfail.values.episode import Outcome
from eigenfail_api.dashboard.suites_page import pool_failures
from eigenfail_services.statistics.intervals import rate


@pytest.fixture
def make(http, fields, deliver, result):
    """Creates a campaign of a suite, with a failure and a safe episode."""

    def create(name, **changes):
        made = http.post("/api/v1/campaigns", json={**fields, "name": name, **changes}).json()["id"]
        deliver(made, result(0, Outcome.COLLISION), result(1))
        return made

    return create


def test_without_a_suite_the_page_says_how_to_run_one(check_page, make):
    make("alone")
    check_page("dashboard/suites/none", "/suites")
    check_page("dashboard/suites/none_older", "/suites?before=1")


def test_suites_are_listed_with_their_states(http, check_page, make):
    make("sweep: a")
    http.post("/api/v1/campaigns/1/cancel")
    make("sweep: b", episodes=20)
    check_page("dashboard/suites/one", "/suites")


def test_members_have_only_what_differs_as_columns(check_page, make):
    make("sweep: a", seed=1)
    make("sweep: b", seed=2, scenario_parameters={"distance_m": 60.0})
    check_page("dashboard/suite/two_members", "/suites/sweep")


def test_members_are_compared_with_those_of_their_other_seeds(http, make):
    for name, distance_m in (("near", 53.0), ("far", 60.0)):
        for seed in (1, 2):
            drawn = {"distance_m": distance_m}
            make(f"s: {name} {seed}", seed=seed, scenario_parameters=drawn)
    page = http.get("/suites/s").text
    assert page.count("/comparison?a=1,2&amp;b=3,4") == 2
    assert page.count("/comparison?") == 2


def test_a_member_draws_its_parameters_in_words(check_page, make):
    for name in ("s: a", "s: a"):  # the newer one stands for the older
        make(name)
    make("s: b", scenario_parameters={"distance_m": {"uniform": [55.0, 60.0]}})
    check_page("dashboard/suite/drawn_parameters", "/suites/s")


def test_a_member_says_why_it_ended_only_if_it_ended_early(store, http, make):
    for name, because in (("s: a", BUDGET_SPENT.format(2)), ("s: b", "The method had no more.")):
        campaign = make(name, episodes=2)
        store.campaigns.move(campaign, "done", because)
    page = http.get("/suites/s").text
    assert "budget of" not in page
    assert page.count("The method had no more.") == 1


def test_names_are_quoted_and_escaped(http, make):
    make("a/b <i>@ 1: one")
    page = http.get("/suites").text
    assert '<a href="/suites/a%2Fb%20%3Ci%3E%40%201">a/b &lt;i&gt;@ 1</a>' in page
    assert "<h1>a/b &lt;i&gt;@ 1</h1>" in http.get("/suites/a%2Fb%20%3Ci%3E%40%201").text


def test_a_suite_that_there_is_not_is_a_page_too(check_page):
    check_page("dashboard/suite/unknown", "/suites/nobody", status=404)


def test_seeds_of_one_campaign_have_a_row_of_means(http, look, make, deliver, result):
    for seed in (1, 2, 3):
        make(f"s: seed={seed}", seed=seed)
    deliver(3, result(2, Outcome.COLLISION))
    text = look("/suites/s")
    # 4 of 7 episodes; the mean of the three shares is in the table below
    assert "rate of all episodes, means over 3 seeds 57.1 % 95 %: [25.0, 84.2]" in text
    assert (
        "Share of episodes that failed, mean over 3 seeds [95 % interval of the mean]: 55.6 % "
        "[31.6, 79.5]; median 50.0 %, fewest 50.0 %, with seed 1."
    ) in text
    assert 'aria-label="Over seeds"' in http.get("/suites/s").text


def test_each_group_of_seeds_has_its_row(look, make):
    for distance_m in (53.0, 60.0):
        for seed in (1, 2):
            name = f"s: {distance_m:g} {seed}"
            make(name, seed=seed, scenario_parameters={"distance_m": distance_m})
    text = look("/suites/s")
    for distance_m in (53, 60):
        pooled = "rate of all episodes, means over 2 seeds 50.0 % 95 %: [15.0, 85.0]"
        assert f"distance_m={distance_m}: {pooled}" in text


def test_without_several_seeds_there_is_no_mean(look, make):
    make("s: a", seed=1)
    make("s: b", seed=2, planner="rulebook")
    assert "Over seeds" not in look("/suites/s")


def test_two_settings_make_a_map_of_the_failures(http, check_page, deliver, make, result):
    made = {}
    for planner in ("idm", "rulebook"):
        for distance_m in (53.0, 60.0):
            drawn = {"distance_m": distance_m}
            name = f"grid: {planner} {distance_m}"
            made[planner, distance_m] = make(name, planner=planner, scenario_parameters=drawn)
    deliver(made["idm", 60.0], *(result(index) for index in range(2, 10)))
    check_page("dashboard/suite/heat_map", "/suites/grid")
    page = http.get("/suites/grid").text
    assert page.count("heat-5") == 3
    assert page.count("heat-1") == 1  # a tenth, where the largest rate is a half
    assert "1 of 10; 95 %: [1.78, 40.5]" in page


def test_what_a_search_chose_is_no_rate_of_the_map(http, make):
    for method in ("monte_carlo", "cem"):
        for distance_m in (53.0, 60.0):
            drawn = {"distance_m": distance_m}
            make(f"g: {method} {distance_m}", method=method, scenario_parameters=drawn)
    page = http.get("/suites/g").text
    assert page.count("heat-search") == 2
    assert page.count("heat-5") == 2
    (cells,) = re.findall(r'<table class="flush heat">.*?</table>', page, re.DOTALL)
    assert cells.count("50.0 %") == 2
    assert cells.count("chosen by the search") == 2


def test_seeds_of_a_cell_are_one_sample(http, make, deliver, result):
    for seed in (1, 2):
        for planner in ("idm", "rulebook"):
            for distance_m in (53.0, 60.0):
                drawn = {"scenario_parameters": {"distance_m": distance_m}, "planner": planner}
                made = make(f"g: {planner} {distance_m} {seed}", seed=seed, **drawn)
                deliver(made, *(result(index) for index in range(2, 2 * seed)))
    assert "2 of 6; 95 %: [" in http.get("/suites/g").text


def test_a_single_setting_makes_no_map(look, make):
    make("s: a", planner="idm")
    make("s: b", planner="rulebook")
    assert "Failures by" not in look("/suites/s")


def test_member_that_completed_nothing_counts_in_the_pooled_upper_bound():
    fine = SimpleNamespace(failure_rate=rate(0, 100), counts=SimpleNamespace(errored=0))
    lost = SimpleNamespace(failure_rate=None, counts=SimpleNamespace(errored=100))
    rows = [SimpleNamespace(summary=each) for each in (fine, fine, lost)]
    assert pool_failures(rows) == rate(0, 200, 100)
    assert pool_failures([rows[0], rows[2]]) == rate(0, 100, 100)
    assert pool_failures([rows[2]]) is None
