"""Two campaigns side by side, and how diverse failures are, as pages."""

from msgspec.structs import replace

from eigenfail.values import AnalysisSettings, Diversity, Outcome


def test_the_page_asks_for_campaigns_and_compares_them(http, fields, deliver, result, look):
    specs = (fields, {**fields, "planner": "rulebook", "scenario_parameters": {"distance_m": 60.0}})
    a, b = (http.post("/api/v1/campaigns", json=spec).json()["id"] for spec in specs)
    for campaign, crashes in ((a, (1, 2)), (b, (1, 3, 4, 5))):
        made = (result(i, Outcome.COLLISION if i in crashes else Outcome.SAFE) for i in range(10))
        deliver(campaign, *made)
    assert "Name one campaign on each side" in look("/comparison")
    assert "Name one campaign on each side" in look(f"/comparison?a={a}")
    text = look(f"/comparison?a={a}&b={b}")
    assert "A fails in 20.0 % [5.7, 51.0] of 10 episodes" in text
    assert "Both saw the same noise in 10 pairs" in text
    assert f"Campaign {a} is running" in text
    assert "differ in more than one thing (scenario, planner)" in text
    assert "scenario_parameters.distance_m default 60.0" in text
    assert "Failure rate, 95 % interval 20.0 %, 5.67 – 51.0 % 40.0 %" in text


def test_what_cannot_be_compared_is_a_problem_for_people(look, campaign):
    assert "Not found" in look(f"/comparison?a={campaign}&b=99", 404)
    assert "named twice" in look(f"/comparison?a={campaign}&b={campaign}", 422)
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


def test_a_collapse_is_warned_of_beside_the_modes(look, store, campaign, finished):
    analysis = finished(2)
    assert "Effective modes" not in look(f"/analyses/{analysis}")
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
    text = look(f"/analyses/{fresh}")
    assert "mode collapse: 95 % of the failures are of one mode" in text
    assert "Effective modes 1.22 of 2, clusters beyond noise" in text
    assert "modes by tenths: 1, 1, 1, 1, 1, 2, 2, 2, 2, 2" in text
