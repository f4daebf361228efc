"""Safety and cost of a campaign, as a part of its page and a page by itself."""

from types import SimpleNamespace

import pytest
from accepted import accept_spec
from msgspec.structs import replace
from tests.support.chart_tables import read_rows

from eigenfail.presentation.campaigns import list_severity
from eigenfail.values.analysis import FEWEST_OF_MODE
from eigenfail.values.campaign import Overhead
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import Outcome
from eigenfail.values.estimates import Interval
from eigenfail.values.measures import Measures
from eigenfail.values.safety import FailurePoint, Figure, Scatter, SeverityRisk
from eigenfail_api.dashboard.measures_page import describe_kind, make_scatter_chart


@pytest.fixture
def driven(campaign, deliver, result, store):
    """A campaign of ten episodes, three of them collisions, that cost 1 USD."""
    crash = Measures(
        *(0.0, 25.0, 0.5, 9.0),
        ttc_violated_s=1.0,
        drac_violated_s=2.75,
        drac_at_warning_mps2=4.0,
        collided_s=3.0,
    )
    deliver(
        campaign,
        *(replace(result(index, Outcome.COLLISION), measures=crash) for index in range(3)),
        replace(result(3), measures=Measures(0.5, min_ttc_s=1.2, max_drac_mps2=2.0)),
        *(result(index) for index in range(4, 10)),
    )
    store.campaigns.add_active(campaign, 3000.0, Overhead(600.0, 300.0, 0.0))
    return campaign


def test_a_campaign_with_failures_as_it_runs_and_when_it_is_done(check_page, store, driven):
    page = f"/campaigns/{driven}"
    check_page("dashboard/campaign/running", page)
    check_page("dashboard/measures/running", f"{page}/measures")
    store.campaigns.move(driven, "done")
    check_page("dashboard/campaign/done", page, "live")
    check_page("dashboard/measures/done", f"{page}/measures", "measures")


def test_the_table_of_the_paper(look, driven):
    text = look(f"/campaigns/{driven}/measures")
    # Wilson's intervals of 3, 1 and 4 in 10.
    assert "Collision 3 30.0 % 95 %: [10.7, 60.4] – –" in text
    assert "Near miss 1 10.0 % 95 %: [1.78, 40.5]" in text
    assert "MinTTC below 1.5 s 4 40.0 % 95 %: [16.8, 68.8] 0.500 s 0.500 s 4" in text


def test_cost_and_time_sum_to_what_was_billed(look, driven):
    text = look(f"/campaigns/{driven}/measures")
    # 50 min at 1.20 USD/h for three failures.
    assert "Spent 1.00 USD 0.833 instance-hours at 1.20 USD/h × 1" in text
    assert "Per failure 0.333 USD 3 failures" in text
    times = ("70.0 % 35 min", "20.0 % 10 min", "10.0 % 5 min")
    assert [text.count(each) for each in times] == [1, 1, 1]


def test_an_analysis_that_finds_distinct_modes_prices_them(look, store, driven, finished):
    first = store.analyses.get(finished(2)).result
    analysis = store.analyses.create(driven, store.analyses.get(1).settings).id
    store.analyses.start(analysis)
    modes = tuple(replace(mode, failures=FEWEST_OF_MODE) for mode in first.modes)
    found = replace(first, silhouette=0.5, noise_silhouette=0.2, modes=modes)
    store.analyses.finish(analysis, found)
    text = look(f"/campaigns/{driven}/measures")
    assert "Per distinct mode 0.500 USD 2 distinct modes" in text
    assert f"Analysis {analysis}" in text


def test_without_an_episode_there_is_nothing_to_tell_now_or_ever(check_page, store, campaign):
    page = f"/campaigns/{campaign}"
    check_page("dashboard/measures/not_yet", f"{page}/measures")
    store.campaigns.move(campaign, "cancelled")
    check_page("dashboard/measures/never", f"{page}/measures")
    check_page("dashboard/campaign/cancelled", page, "live")


@pytest.mark.parametrize(
    "moves", [(), ("pausing", "paused"), ("done",), ("cancelling", "cancelled"), ("dead",)]
)
def test_what_a_tail_takes_is_true_in_every_state(look, store, driven, moves):
    for state in moves:
        store.campaigns.move(driven, state)
    text = look(f"/campaigns/{driven}/measures")
    assert "hence 100 failures in all; " in text
    assert "Let it run on" not in text


def test_a_function_has_a_price_but_no_traffic(check_page, store, deliver, result):
    spec = CampaignSpec(
        name="f",
        method="monte_carlo",
        episodes=2,
        simulator="function",
        scenario="function",
        planner="my_module:robustness",
        scenario_parameters={"steps": 4},
    )
    campaign = store.campaigns.create(accept_spec(spec)).id
    deliver(campaign, result(0))
    check_page("dashboard/measures/function", f"/campaigns/{campaign}/measures")


@pytest.mark.parametrize("address", ["/campaigns/{}", "/campaigns/{}/measures"])
def test_no_page_reads_all_episodes(http, store, driven, monkeypatch, address):
    def refuse(*_):
        raise AssertionError("all episodes were asked for")

    for question in ("failure_portions", "digest"):
        monkeypatch.setattr(store.episodes, question, refuse)
    assert http.get(address.format(driven)).status_code == 200


def test_a_figure_has_its_interval_or_says_that_it_has_none():
    none = Scatter((), 0, Figure(2.0))
    risk = SeverityRisk(level=0.95, n=4, beyond=0.2, mean=Figure(2.0, Interval(1.0, 3.0)))
    found = SimpleNamespace(severity=risk, scatter=none)
    mean, tail, _, correlation = (cell.lines for _, cell in list_severity(found))
    assert mean == ("2.00", "95 %: [1.00, 3.00]", "n = 4")
    assert tail == ("–", "too few failures", "0.200 failures beyond")
    assert correlation == ("2.00", "no interval", "Spearman, n = 0")


def test_the_scatter_tells_classes_and_what_it_leaves_out():
    points = (FailurePoint(3, -2.5, 25.0, None), FailurePoint(5, -2.0, 9.0, "unavoidable"))
    assert [describe_kind(point) for point in points] == ["not classified", "unavoidable"]
    chart = make_scatter_chart(Scatter(points, 40))
    assert chart.caption.endswith("2 of 40.")
    assert read_rows(chart.table)[1] == ("5", "−2.00", "9.00", "unavoidable")
