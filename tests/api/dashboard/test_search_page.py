"""The search: campaigns, episodes, failure modes and suites by id or by a part of their names."""

import re

import pytest

from eigenfail_api.dashboard.search_page import MOST_HITS


@pytest.fixture
def hits(http):
    """The addresses of what is found, in order."""

    def find(text):
        answer = http.get("/search", params={"q": text})
        assert answer.status_code == 200
        return re.findall(r'<li><a href="([^"]+)"', answer.text)

    return find


@pytest.fixture
def make(http, fields):
    def create(name, **more):
        return http.post("/api/v1/campaigns", json={**fields, "name": name, **more}).json()["id"]

    return create


def test_ids_and_names_are_found(hits, make, deliver, result):
    night, day = make("Night drive"), make("day: 7")
    deliver(night, result(0), result(1))
    assert hits("NIGHT") == [f"/campaigns/{night}"]
    assert hits(f"  #{night} ") == [f"/campaigns/{night}"]
    assert hits(f"{night}/1") == [f"/campaigns/{night}/episodes/1"]
    assert hits(f"{night}/2") == []
    assert hits("day") == [f"/campaigns/{day}", "/suites/day"]
    assert hits("7") == [f"/campaigns/{day}"]
    assert hits("") == []


def test_a_mode_is_found_by_its_name(http, hits, finished):
    analysis = finished()
    address = f"/api/v1/analyses/{analysis}/modes/1/name"
    assert http.put(address, json={"name": "Late 100% braking"}).status_code == 200
    assert hits("late 100%") == [f"/analyses/{analysis}/modes/1"]
    assert hits("late 10_%") == []


def test_more_campaigns_than_the_page_has_are_a_list_away(http, hits, make):
    made = [make("sweep") for _ in range(MOST_HITS + 1)]
    assert hits("sweep") == [f"/campaigns/{each}" for each in made[:0:-1]]
    page = http.get("/search?q=sweep").text
    assert 'href="/?search=sweep&amp;archived=true"' in page
    assert f"The first {MOST_HITS} are listed, and there are more." in page


def test_a_list_that_is_not_cut_says_nothing_of_more(http, make):
    for _ in range(MOST_HITS):
        make("sweep")
    assert "are listed, and there are more" not in http.get("/search?q=sweep").text


def test_suites_are_cut_with_words(http, hits, make):
    for number in range(MOST_HITS + 1):
        make(f"nightly {number}: drive", tags=["wet"])
    page = http.get("/search?q=nightly").text
    assert page.count(f"The first {MOST_HITS} are listed, and there are more.") == 2
    assert page.count("Type a longer part of the name.") == 1
    assert len([each for each in hits("nightly") if each.startswith("/suites/")]) == MOST_HITS
    link = '<a href="/?tag=wet&amp;archived=true">List them without replays</a>'
    assert link in http.get("/search?q=wet").text


def test_campaigns_are_found_by_their_planners_version_and_by_tags(http, hits, make):
    old, new = (make("drive", planner_version=version, tags=["wet"]) for version in ("v1", "v1.1"))
    make("other")
    assert hits("v1") == [f"/campaigns/{old}"]
    assert hits("v1.1") == [f"/campaigns/{new}"]
    assert hits("wet") == [f"/campaigns/{new}", f"/campaigns/{old}"]
    assert hits("we") == []
    assert "Campaigns of planner version v1.1" in http.get("/search?q=v1.1").text
    assert "Campaigns with the tag wet" in http.get("/search?q=wet").text


def test_what_is_typed_is_escaped_and_bounded(http, hits):
    nasty = '"><script>alert(1)</script>'
    answer = http.get("/search", params={"q": nasty})
    assert "<script>alert" not in answer.text
    assert "Nothing matches" in answer.text
    for odd in ("%", "_", "\x00", "9" * 19 + "/" + "9" * 19, "9" * 40, "0", "1/", "é'"):
        assert hits(odd) == []
    assert http.get("/search", params={"q": "x" * 201}).status_code == 422


def test_the_page_begins_with_an_empty_field(check_page):
    check_page("dashboard/search/empty", "/search")
