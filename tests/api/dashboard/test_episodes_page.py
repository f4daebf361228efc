"""The page on which episodes are found."""

import html
import json
import re

import pytest
from msgspec.structs import replace

from eigenfail.values.episode import Outcome
from eigenfail.values.measures import Measures
from eigenfail.values.records import Delivery
from eigenfail_api.dashboard import charts, episodes_page


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
    return [int(index) for index in re.findall(r'<th scope="row"><a href="[^"?]*/(\d+)[?"]', page)]


def lines(page):
    """What is drawn."""
    values = re.search(r'data-chart="parallel"[^>]*data-values="([^"]*)"', page)[1]
    return json.loads(html.unescape(values))


def get(http, campaign, status=200, **asked):
    response = http.get(f"/campaigns/{campaign}/episodes", params=asked)
    assert response.status_code == status, response.text
    return response.text


def test_all_episodes_are_listed_and_drawn(http, filled, check_page):
    drawn = lines(get(http, filled))
    assert len(drawn["failure"]) == 9
    assert drawn["values"][drawn["columns"].index("severity")][:2] == [1.0, 11.0]
    check_page("dashboard/episodes/all", f"/campaigns/{filled}/episodes")


def test_filter_and_sort_are_in_the_address(http, filled, check_page):
    asked = "filter=severity > 15 and outcome = collision&sort=-severity"
    check_page("dashboard/episodes/filtered", f"/campaigns/{filled}/episodes?{asked}")
    page = http.get(f"/campaigns/{filled}/episodes?{asked}").text
    assert listed(page) == [4, 3, 2]
    assert len(lines(page)["failure"]) == 3


def test_pages_follow_each_other(http, filled, monkeypatch):
    monkeypatch.setattr(episodes_page, "EPISODES_ON_A_PAGE", 4)
    found, address = [], f"/campaigns/{filled}/episodes?sort=-severity"
    while address:
        page = http.get(address).text
        found += listed(page)
        following = re.search(r'<a href="([^"]*)" rel="next">', page)
        address = html.unescape(following[1]) if following else None
    assert found == [4, 3, 2, 1, 0, 8, 7, 6, 5]
    assert "First page" in page


def test_a_wrong_filter_is_told_in_words_beside_it(filled, check_page):
    address = f"/campaigns/{filled}/episodes?filter=sevrity > 15"
    check_page("dashboard/episodes/wrong_filter", address, status=422)


def test_a_filter_is_never_markup(http, filled):
    wrong = "<script>alert(1)</script>"
    assert wrong not in get(http, filled, status=422, filter=wrong)


def test_an_order_that_there_is_not_is_a_problem(http, filled):
    assert "Did you mean" in html.unescape(get(http, filled, status=422, sort="sevrity"))


def test_nothing_is_said_in_words(http, campaign, filled, fields, check_page):
    other = http.post("/api/v1/campaigns", json=fields).json()["id"]
    address = f"/campaigns/{filled}/episodes"
    check_page("dashboard/episodes/no_match", f"{address}?filter=severity > 999", "found")
    check_page("dashboard/episodes/none", f"/campaigns/{other}/episodes")
    check_page("dashboard/episodes/none_further", f"{address}?after=8", "found")


def test_an_episode_leads_to_its_neighbours_in_the_list_that_it_was_reached_from(http, filled):
    page = get(http, filled, filter="outcome = collision and severity < 30", sort="-severity")
    assert listed(page) == [2, 1, 0]
    address = html.unescape(re.search(r'<th scope="row"><a href="([^"]*/2\?[^"]*)"', page)[1])
    walked, listings = [], set()
    while address:
        page = http.get(address).text
        walked.append(int(re.search(r"/episodes/(\d+)", address)[1]))
        listings |= {*re.findall(r'<a href="([^"]*)">episodes</a>', page)}
        following = re.search(r'rel="next" href="([^"]*)"', page)
        address = html.unescape(following[1]) if following else None
    assert walked == [2, 1, 0]
    (back,) = listings
    assert listed(http.get(html.unescape(back)).text) == [2, 1, 0]
    assert "Previous episode (1)" in page


def test_the_way_back_is_the_way_there_where_values_are_missing(http, filled):
    address, walked = f"/campaigns/{filled}/episodes/5?filter=&sort=-severity", []
    while address:
        walked.append(int(re.search(r"/episodes/(\d+)", address)[1]))
        before = re.search(r'rel="prev" href="([^"]*)"', http.get(address).text)
        address = html.unescape(before[1]) if before else None
    assert walked[::-1] == listed(get(http, filled, sort="-severity"))


def test_a_list_that_cannot_be_is_refused_on_the_page_of_an_episode_too(http, filled):
    address = f"/campaigns/{filled}/episodes/2"
    for wrong in ({"filter": "sevrity > 15"}, {"filter": "", "sort": "sevrity"}):
        assert http.get(address, params=wrong).status_code == 422


def test_the_files_hold_what_the_list_shows(http, filled):
    page = get(http, filled, filter="severity > 15", sort="-severity")
    address = html.unescape(re.search(r'href="([^"]*episodes\.csv[^"]*)"', page)[1])
    rows = http.get(address).text.splitlines()[1:]
    assert [int(row.split(",")[1]) for row in rows] == listed(page)


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
