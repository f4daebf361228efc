"""Safety and cost of a campaign, as a part of its page and a page by itself."""

from types import SimpleNamespace

import pytest
from msgspec.structs import replace

from eigenfail.presentation.campaigns import list_severity
from eigenfail.values import (
    CampaignSpec,
    Figure,
    Interval,
    Measures,
    Outcome,
    Overhead,
)
from eigenfail.values.safety import FailurePoint, Scatter, SeverityRisk
from eigenfail_api.dashboard import campaign_page
from eigenfail_api.dashboard.measures_page import describe_kind, make_scatter_chart
from eigenfail_services.campaigns.summary import find_safety

HTML = {"Accept": "text/html"}


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


def test_a_campaign_page_links_its_parts_and_its_report(http, driven, monkeypatch):
    monkeypatch.setattr(campaign_page, "is_prefetched", lambda begun: False)
    html = http.get(f"/campaigns/{driven}", headers=HTML).text
    assert f'hx-get="/campaigns/{driven}/measures"' in html
    assert f'<a href="/campaigns/{driven}/measures">' in html
    assert f'href="/api/v1/report?campaign={driven}&amp;format=html" download' in html


def test_a_campaign_page_offers_every_form_in_which_its_results_can_be_had(http, driven):
    html = http.get(f"/campaigns/{driven}", headers=HTML).text
    for form in ("zip", "json"):
        assert f'href="/api/v1/report?campaign={driven}&amp;format={form}" download' in html
    for form in ("csv", "ndjson"):
        assert f'href="/api/v1/campaigns/{driven}/episodes.{form}" download' in html
    assert f'data-export="/api/v1/campaigns/{driven}/exports"' in html


def test_both_parts_say_as_of_when_they_are(look, store, driven):
    assert "As of 10 completed episodes, 20" in look(f"/campaigns/{driven}")
    assert "As of 10 completed episodes; updated less" in look(f"/campaigns/{driven}/measures")
    store.campaigns.move(driven, "done")
    assert "As of" not in look(f"/campaigns/{driven}")


def test_the_table_of_the_paper(look, driven):
    text = look(f"/campaigns/{driven}/measures")
    assert "Collision 3 30.0 % 95 %: [10.7, 60.4] – –" in text
    assert "Near miss 1 10.0 % 95 %: [1.78, 40.5]" in text
    assert "MinTTC below 1.5 s 4 40.0 % 95 %: [16.8, 68.8] 0.500 s 0.500 s 4" in text
    assert "DRAC above 7 m/s² 3 30.0 % 95 %: [10.7, 60.4] 9.00 m/s² 9.00 m/s² 4" in text


def test_severity_and_why_its_tail_is_not_told(look, driven):
    text = look(f"/campaigns/{driven}/measures")
    assert "Mean severity [m²/s²] 25.0 95 %: [25.0, 25.0] n = 3" in text
    assert "VaR 95 % [m²/s²] – too few failures" in text
    assert "3 failures leave 0.15 beyond the quantile of 0.95" in text


def test_cost_and_time_sum_to_what_was_billed(look, driven):
    text = look(f"/campaigns/{driven}/measures")
    assert "Spent 1.00 USD 0.833 instance-hours at 1.20 USD/h × 1" in text
    assert "Per failure 0.333 USD 3 failures" in text
    assert "Per distinct mode – no distinct modes found" in text
    assert f"No analysis is done: `eigenfail analyze {driven}`, or Analyse on its page." in text
    assert "70.0 % 35 min" in text
    assert "20.0 % 10 min" in text
    assert "10.0 % 5 min" in text
    assert "discarded results 0 %" in text


def test_an_analysis_that_finds_distinct_modes_prices_them(look, store, driven, finished):
    first = store.analyses.get(finished(2)).result
    analysis = store.analyses.create(driven, store.analyses.get(1).settings).id
    store.analyses.start(analysis)
    store.analyses.finish(analysis, replace(first, silhouette=0.5, noise_silhouette=0.2))
    text = look(f"/campaigns/{driven}/measures")
    assert "Per distinct mode 0.500 USD 2 distinct modes" in text
    assert f"Analysis {analysis}" in text


def test_without_an_episode_there_is_nothing_to_tell_now_or_ever(look, store, campaign):
    assert "after the first episode" in look(f"/campaigns/{campaign}/measures")
    assert "appear with the first results" in look(f"/campaigns/{campaign}")
    store.campaigns.move(campaign, "cancelled")
    assert "No episode was completed: there are no" in look(f"/campaigns/{campaign}/measures")
    text = look(f"/campaigns/{campaign}")
    assert "there are no charts" in text
    assert "yet" not in text.split("Failures Search")[0]


def test_figures_that_lag_say_of_how_many_episodes_they_are(look, store, driven):
    address = f"/campaigns/{driven}/measures"
    assert "As of 10 completed episodes; updated less often" in look(address)
    assert "Cost so far" in look(f"/campaigns/{driven}")
    store.campaigns.move(driven, "done")
    assert "Over all completed episodes: 10." in look(address)
    assert "Total cost" in look(f"/campaigns/{driven}")


@pytest.mark.parametrize(
    "moves", [(), ("pausing", "paused"), ("done",), ("cancelling", "cancelled"), ("dead",)]
)
def test_what_a_tail_takes_is_true_in_every_state(look, store, driven, moves):
    for state in moves:
        store.campaigns.move(driven, state)
    text = look(f"/campaigns/{driven}/measures")
    assert "take 5: 100 failures. They need more episodes, or a lower level." in text
    assert "Let it run on" not in text


def test_a_campaign_that_is_not_there_is_a_problem(look):
    assert "Not found" in look("/campaigns/7/measures", 404)


def test_a_function_has_a_price_but_no_traffic(look, store, deliver, result):
    spec = CampaignSpec(name="f", method="monte_carlo", episodes=2, simulator="function")
    campaign = store.campaigns.create(replace(spec, scenario="function")).id
    deliver(campaign, result(0))
    text = look(f"/campaigns/{campaign}/measures")
    assert "Safety measures Measure" not in text
    assert "Spent" in text


@pytest.mark.parametrize("address", ["/campaigns/{}", "/campaigns/{}/measures"])
def test_no_page_reads_all_episodes(http, store, driven, monkeypatch, address):
    def refuse(*_):
        raise AssertionError("all episodes were asked for")

    for question in ("failures", "failure_portions", "digest"):
        monkeypatch.setattr(store.episodes, question, refuse)
    assert http.get(address.format(driven), headers=HTML).status_code == 200


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
    assert chart.rows[1] == ("5", "−2.00", "9.00", "unavoidable")


def test_severity_without_failures_says_nothing(store, campaign, deliver, result):
    deliver(campaign, result(0))
    risk = find_safety(store, store.campaigns.get(campaign)).severity
    assert isinstance(risk, SeverityRisk)
    assert risk.n == 0
