"""The page on which episodes are found."""

import html
import json
import re

import pytest
from msgspec.structs import replace

from eigenfail.values import Measures, Outcome
from eigenfail.values.records import Delivery
from eigenfail_api.dashboard import charts, episodes_page

HTML = {"Accept": "text/html"}


@pytest.fixture
def filled(store, campaign, deliver, result, failed):
    """Five collisions of rising severity, three safe episodes, one that could not be run."""
    crashes = [
        replace(result(i, Outcome.COLLISION), measures=Measures(0.0, severity=10.0 * i + 1.0))
        for i in range(5)
    ]
    deliver(campaign, *crashes, *(result(i) for i in (5, 6, 7)), failed(8))
    return campaign


def listed(page):
    """The episodes in the list, in its order."""
    return [int(index) for index in re.findall(r'<th scope="row"><a href="[^"]*/(\d+)"', page)]


def lines(page):
    """What is drawn."""
    values = re.search(r'data-chart="parallel"[^>]*data-values="([^"]*)"', page)[1]
    return json.loads(html.unescape(values))


def get(http, campaign, status=200, **asked):
    response = http.get(f"/campaigns/{campaign}/episodes", params=asked, headers=HTML)
    assert response.status_code == status, response.text
    return response.text


def test_a_single_episode_is_not_called_several(look, campaign, deliver, result):
    deliver(campaign, result(0))
    assert "The only episode that matches. One line" in look(f"/campaigns/{campaign}/episodes")


def test_all_episodes_are_listed_and_drawn(http, filled):
    page = get(http, filled)
    assert listed(page) == list(range(9))
    drawn = lines(page)
    assert len(drawn["collision"]) == 9
    assert drawn["values"][drawn["columns"].index("severity")][:2] == [1.0, 11.0]
    assert "All 9 episodes that match" in page


def test_filter_and_sort_are_in_the_address(http, filled):
    page = get(http, filled, filter="severity > 15 and outcome = collision", sort="-severity")
    assert listed(page) == [4, 3, 2]
    assert 'value="severity &gt; 15 and outcome = collision"' in page
    assert '<input type="hidden" name="sort" value="-severity">' in page
    assert 'aria-sort="descending"' in page
    assert page.count("aria-sort") == 1
    assert len(lines(page)["collision"]) == 3


def test_heads_turn_the_order_round(http, filled):
    page = get(http, filled, filter="severity > 1", sort="-severity")
    heads = html.unescape(page)
    assert f"/campaigns/{filled}/episodes?filter=severity+%3E+1&sort=severity" in heads
    assert f"/campaigns/{filled}/episodes?filter=severity+%3E+1&sort=min_ttc_s" in heads


def test_pages_follow_each_other(http, filled, monkeypatch):
    monkeypatch.setattr(episodes_page, "EPISODES_ON_A_PAGE", 4)
    found, address = [], f"/campaigns/{filled}/episodes?sort=-severity"
    while address:
        page = http.get(address, headers=HTML).text
        found += listed(page)
        following = re.search(r'<a href="([^"]*)" rel="next">', page)
        address = html.unescape(following[1]) if following else None
    assert found == [4, 3, 2, 1, 0, 8, 7, 6, 5]
    assert "First page" in page


def test_a_wrong_filter_is_told_in_words_beside_it(http, filled):
    page = get(http, filled, status=422, filter="sevrity > 15")
    words = html.unescape(page)
    assert "filter, character 1: 'sevrity' is not known. Did you mean 'severity'?" in words
    assert 'value="sevrity &gt; 15"' in page
    assert 'aria-invalid="true"' in page
    assert listed(page) == []


def test_a_filter_is_never_markup(http, filled):
    wrong = "<script>alert(1)</script>"
    assert wrong not in get(http, filled, status=422, filter=wrong)


def test_an_order_that_there_is_not_is_a_problem(http, filled):
    assert "Did you mean" in html.unescape(get(http, filled, status=422, sort="sevrity"))


def test_nothing_is_said_in_words(http, look, campaign, filled, fields):
    assert "No episodes match this filter." in get(http, filled, filter="severity > 999")
    other = http.post("/api/v1/campaigns", json=fields).json()["id"]
    page = get(http, other)
    assert "No episode has ended yet." in page
    assert 'data-chart="parallel"' not in page
    assert "There are no further episodes." in get(http, filled, after=8)


def test_the_files_hold_what_the_list_shows(http, filled):
    page = get(http, filled, filter="severity > 15", sort="-severity")
    address = html.unescape(re.search(r'href="([^"]*episodes\.csv[^"]*)"', page)[1])
    rows = http.get(address).text.splitlines()[1:]
    assert [int(row.split(",")[1]) for row in rows] == listed(page)
    command = f"eigenfail episode export {filled} -o episodes.parquet --filter 'severity > 15'"
    assert command in html.unescape(page)


def test_a_campaign_leads_to_its_episodes(http, filled):
    page = html.unescape(http.get(f"/campaigns/{filled}", headers=HTML).text)
    assert f'href="/campaigns/{filled}/episodes?filter=outcome+%3D+collision"' in page
    assert "episodes?filter=outcome+%3D+collision&sort=-severity" in page


def test_a_sample_is_spread_over_the_campaign(http, store, fields, result, monkeypatch):
    monkeypatch.setattr(charts, "LINES", 8)
    monkeypatch.setattr(charts, "STRETCHES", 4)
    long = http.post("/api/v1/campaigns", json={**fields, "episodes": 40}).json()["id"]
    store.campaigns.move(long, "running")
    store.episodes.commit(long, [Delivery(result(index), "w") for index in range(40)])
    drawn = charts.spread(store, store.campaigns.get(long), ())
    assert [row.index for row in drawn.rows] == [0, 1, 10, 11, 20, 21, 30, 31]
    assert not drawn.is_all
    assert "A sample of 8 of the episodes that match." in get(http, long)
