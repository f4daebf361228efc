"""The menu of saved views: its forms work without JavaScript, and lead back to the list."""

import re
from urllib.parse import parse_qsl

import pytest

from eigenfail.views import ViewPage, ViewRequest, check_view

HTML = {"Accept": "text/html", "Origin": "http://127.0.0.1:8440"}


def send(http, path, **fields):
    return http.post(path, data=fields, headers=HTML, follow_redirects=False)


@pytest.fixture
def lists(campaign):
    """Addresses of the lists, each with a query, by page."""
    return {
        "campaigns": "/?state=done&sort=-failures&archived=true&tag=night",
        "episodes": f"/campaigns/{campaign}/episodes?filter=severity+%3E+80&sort=-severity",
        "failures": "/failures?state=known&planner=idm&sort=severity",
    }


@pytest.mark.parametrize("name", [*ViewPage])
def test_a_list_is_saved_as_it_is_shown(http, store, lists, campaign, name):
    address = lists[name]
    shown = http.get(address, headers=HTML)
    assert shown.status_code == 200
    query = re.search(r'name="query" value="([^"]*)"', shown.text)[1].replace("&amp;", "&")
    fields = {"page": name, "query": query, "campaign": str(campaign), "name": 'a <b>&"c"'}
    answer = send(http, "/views", **fields)
    assert answer.status_code == 303
    path, _, there = answer.headers["location"].partition("?")
    assert path == address.partition("?")[0]
    (view,) = store.views.page(9).items
    assert view.query == dict(parse_qsl(there)) == dict(parse_qsl(address.partition("?")[2]))
    page = http.get(answer.headers["location"], headers=HTML).text
    assert 'aria-current="true">a &lt;b&gt;&amp;&#34;c&#34;</a>' in page
    renamed = send(http, f"/views/{view.id}/name", name="b", campaign=str(campaign))
    assert renamed.headers["location"] == answer.headers["location"]
    assert store.views.get(view.id).name == "b"
    assert send(http, f"/views/{view.id}/delete", campaign=str(campaign)).status_code == 303
    assert store.views.page(9).items == ()


def test_parameters_that_no_page_has_are_left_out_of_the_address(http, store, campaign):
    query = {"fields": "index,severity", "sort": "-severity"}
    store.views.create(ViewRequest("columns", ViewPage.EPISODES, query), "anna")
    text = http.get(f"/campaigns/{campaign}/episodes", headers=HTML).text
    assert f'<a href="/campaigns/{campaign}/episodes?sort=-severity">columns</a>' in text


def test_failures_without_an_owner_are_a_view(http, store):
    query = {"owner": "", "state": "known"}
    view = store.views.create(check_view(ViewRequest("open", ViewPage.FAILURES, query)), "anna")
    assert view.query == query
    answer = send(http, f"/views/{view.id}/name", name="b")
    assert answer.headers["location"] == "/failures?state=known&unowned=true"
    page = http.get(answer.headers["location"], headers=HTML).text
    assert 'name="unowned" value="true" checked' in page
    assert 'aria-current="true">b</a>' in page
    send(http, "/views", name="c", page="failures", query="state=known&unowned=true")
    assert store.views.page(9, name="c").items[0].query == query


@pytest.mark.parametrize(
    ("fields", "status"),
    [
        ({"name": " ", "page": "campaigns"}, 422),
        ({"name": "x", "page": "modes"}, 422),
        ({"name": "x"}, 422),
        ({"name": "x", "page": "campaigns", "query": "state=open"}, 422),
        ({"name": "x", "page": "campaigns", "query": "&".join(["sort=id"] * 101)}, 422),
        ({"name": "x", "page": "episodes"}, 422),
        ({"name": "x", "page": "episodes", "campaign": "²"}, 422),
        ({"name": "taken", "page": "campaigns"}, 409),
    ],
    ids=str,
)
def test_what_cannot_be_is_refused(http, store, fields, status):
    store.views.create(ViewRequest("taken", ViewPage.FAILURES), "anna")
    answer = send(http, "/views", **fields)
    assert answer.status_code == status
    assert answer.headers["content-type"].startswith("text/html")
    assert len(store.views.page(9).items) == 1
