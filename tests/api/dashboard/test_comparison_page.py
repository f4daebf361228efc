"""Two campaigns side by side, and how diverse failures are, as pages."""

import pytest
from accepted import accept_spec
from msgspec.structs import replace
from tests.support.chart_tables import read_headings, read_rows

from eigenfail.values.analysis import AnalysisSettings, Diversity
from eigenfail.values.campaign import Overhead
from eigenfail.values.episode import Outcome
from eigenfail_api.dashboard.overlays import make_bill_charts
from eigenfail_services.campaigns.costs import find_spending


def test_the_page_asks_for_campaigns_and_compares_them(
    *, http, fields, deliver, result, look, check_page
):
    specs = (fields, {**fields, "planner": "rulebook", "scenario_parameters": {"distance_m": 60.0}})
    a, b = (http.post("/api/v1/campaigns", json=spec).json()["id"] for spec in specs)
    for campaign, crashes in ((a, (1, 2)), (b, (1, 3, 4, 5))):
        made = (result(i, Outcome.COLLISION if i in crashes else Outcome.SAFE) for i in range(10))
        deliver(campaign, *made)
    assert "Enter one campaign for each side" in look("/comparison")
    check_page("dashboard/comparison/one_side", f"/comparison?a={a}")
    check_page("dashboard/comparison/two_sides", f"/comparison?a={a}&b={b}")
    # Wilson's interval of 2 in 10.
    assert "Failed [95 %] 20.0 % 95 %: [5.66, 51.0] 40.0 %" in look(f"/comparison?a={a}&b={b}")


@pytest.fixture
def seeds(http, fields, deliver, result):
    """Campaigns that differ in their seeds alone."""
    made = [
        http.post("/api/v1/campaigns", json={**fields, "seed": seed}).json()["id"]
        for seed in range(3)
    ]
    for campaign in made:
        deliver(campaign, *(result(index, Outcome.COLLISION) for index in range(4)))
    return made


def test_cost_and_time_stand_side_by_side(store, seeds, look, check_page):
    a, b, c = seeds
    store.campaigns.add_active(a, 3000.0, Overhead(600.0, 300.0, 0.0))
    store.campaigns.add_active(b, 1500.0, Overhead(0.0, 150.0, 0.0))
    check_page("dashboard/comparison/costs", f"/comparison?a={a}&b={b},{c}")
    text = look(f"/comparison?a={a}&b={b},{c}")
    # 50 and 25 min at 1.20 USD/h, of which 10 and 5 min, and 0 and 2.5 min, were no simulation.
    assert "Spent [USD] 1.00 0.500" in text
    assert "Time: simulation 70.0 % 35 min 90.0 % 22 min 30 s" in text


def test_the_curves_tell_what_each_had_found_by_then(store, seeds):
    long, short, unpaid = seeds
    for campaign, seconds in ((long, 3000.0), (short, 1500.0)):
        store.campaigns.add_active(campaign, seconds)
    costs = [find_spending(store, store.campaigns.get(each)) for each in (long, short)]
    (chart,) = make_bill_charts(costs[:1], costs[1:])
    assert [line["name"][0] for line in chart.data["lines"]] == ["A", "B"]
    assert read_headings(chart.table) == (
        "USD",
        f"A: {long} monte_carlo",
        f"B: {short} monte_carlo",
    )
    assert read_rows(chart.table)[4][2] == read_rows(chart.table)[9][1] == "4"
    assert read_rows(chart.table)[5][2] == "–"
    nothing = store.campaigns.create(accept_spec(store.campaigns.get(unpaid).spec))
    assert make_bill_charts([find_spending(store, nothing)], []) == ()


def test_what_cannot_be_compared_is_a_problem_for_people(look, check_page, campaign):
    check_page("dashboard/comparison/no_campaign", f"/comparison?a={campaign}&b=99", status=404)
    twice = f"/comparison?a={campaign}&b={campaign}"
    check_page("dashboard/comparison/listed_twice", twice, status=422)
    look("/comparison?a=x&b=1", 422)


def test_the_course_of_monte_carlo_is_no_learning_curve(http, fields, deliver, result, look):
    titles = {}
    for method in ("monte_carlo", "cem"):
        made = http.post("/api/v1/campaigns", json={**fields, "method": method}).json()["id"]
        deliver(made, result(0), result(1, Outcome.COLLISION))
        titles[method] = look(f"/campaigns/{made}")
    assert "Failures over episodes" in titles["monte_carlo"]
    assert "Learning curve" not in titles["monte_carlo"]
    assert "Learning curve" in titles["cem"]


def test_a_collapse_is_warned_of_beside_the_modes(check_page, store, campaign, finished):
    analysis = finished(2)
    diversity = Diversity(
        failures=40,
        modes=2,
        largest_share=0.95,
        effective_modes=1.22,
        spread=0.8,
        coverage=(1,) * 5 + (2,) * 5,
        verdict="2 modes",
        warning="mode collapse: 95 % of the failures are of one mode; try `ensemble`.",
    )
    found = replace(store.analyses.get(analysis).result, diversity=diversity)
    fresh = store.analyses.create(campaign, AnalysisSettings()).id
    store.analyses.start(fresh)
    store.analyses.finish(fresh, found)
    check_page("dashboard/analysis/collapse", f"/analyses/{fresh}", "analysis")
