"""The page of the failures of all campaigns."""

import re
from html import unescape

import pytest
from store_checks.failures import fill

from eigenfail_api.dashboard import failures_page


def read(http, address):
    response = http.get(address)
    assert response.status_code == 200
    return response.text


def list_places(text):
    found = re.findall(r'<th scope="row"><a class="word" href="[^"]*">(\d+)/(\d+)</a></th>', text)
    return [(int(campaign), int(index)) for campaign, index in found]


@pytest.fixture
def places(store):
    return sorted(fill(store), reverse=True)


def test_the_worst_failures_come_first_and_lead_to_their_episodes(http, places, golden):
    text = read(http, "/failures")
    assert list_places(text) == [(campaign, index) for _, campaign, index in places]
    first = unescape(re.search(r'<th scope="row"><a class="word" href="([^"]*)"', text)[1])
    assert http.get(first).status_code == 200
    golden.check_page("dashboard/failures/all", text)


def test_pages_follow_each_other(http, places, monkeypatch):
    monkeypatch.setattr(failures_page, "FAILURES_ON_A_PAGE", 7)
    address, found = "/failures?sort=severity", []
    while address:
        text = read(http, address)
        found += list_places(text)
        following = re.search(r'<a href="([^"]*)" rel="next">', text)
        address = following[1].replace("&amp;", "&") if following else ""
    assert found == [(campaign, index) for _, campaign, index in places[::-1]]


def test_filters_stay_in_the_form(http, places):
    text = read(http, "/failures?planner=idm&method=&sort=severity&archived=true")
    assert {campaign for campaign, _ in list_places(text)} == {2, 4}
    assert 'name="planner" maxlength="200" value="idm"' in text
    assert '<input type="hidden" name="archived" value="true">' in text
    assert "No failures match these filters." in read(http, "/failures?project=none")
    assert places


def test_a_place_that_has_gone_leads_to_the_first_page(http, places):
    text = read(http, "/failures?sort=severity&after=7")
    assert list_places(text) == [(campaign, index) for _, campaign, index in places[::-1]]
    assert "This is the first page." in text
    assert "This is the first page." not in read(http, "/failures?sort=severity")
    assert "First page" not in text


def test_the_copied_request_has_the_filter_of_the_page(http, places):
    query = "planner=idm&planner_version=a+b%26&archived=true&sort=severity"
    text = read(http, f"/failures?{query}")
    address = re.search(r'hx-get="(/copies[^"]*)"', text)[1].replace("&amp;", "&")
    copies = unescape(read(http, address))
    assert "/api/v1/failures?planner=idm&planner_version=a+b%26&archived=true" in copies
    assert places


def test_without_failures(http):
    assert "No campaign has found a collision yet." in read(http, "/failures")


@pytest.mark.parametrize("query", ["sort=steps", "after=x", "project=" + "x" * 201])
def test_what_cannot_be_is_refused(http, query):
    assert http.get(f"/failures?{query}").status_code == 422
