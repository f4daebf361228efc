"""The archive over HTTP: lists omit what is archived unless it is asked for."""

import pytest

URL = "/api/v1/campaigns"


@pytest.fixture
def archived(http, store, fields):
    """An archived campaign, and one that is listed."""
    first, second = (http.post(URL, json=fields).json()["id"] for _ in range(2))
    store.campaigns.move(first, "cancelled")
    assert http.post(f"{URL}/{first}/archive").json()["archived_ms"] > 0
    return first, second


def test_lists_omit_archived_campaigns_unless_they_are_asked_for(http, archived):
    first, second = archived
    for path, name in ((URL, "id"), (f"{URL}/summaries", "campaign")):
        assert [each[name] for each in http.get(path).json()["items"]] == [second]
        every = http.get(f"{path}?archived=true").json()["items"]
        assert [each[name] for each in every] == [second, first]
    assert http.get(f"{URL}/{first}").status_code == 200
    assert http.post(f"{URL}/{first}/restore").json()["archived_ms"] is None
    assert len(http.get(URL).json()["items"]) == 2


def test_what_has_not_ended_is_not_archived(http, problem, archived):
    _, second = archived
    assert "cancel it" in problem(http.post(f"{URL}/{second}/archive"), 409)["remedy"]


def test_pages_say_that_a_campaign_is_archived(http, archived):
    first, second = archived
    page = http.get("/").text
    assert f'id="campaign-{second}"' in page
    assert f'id="campaign-{first}"' not in page
    assert 'href="/?archived=true">Show archived campaigns</a>' in page
    every = http.get("/?archived=true&sort=name").text
    assert f'id="campaign-{first}"' in every
    assert '<span class="note">archived</span>' in every
    assert 'href="/?sort=name">Hide archived campaigns</a>' in every
    assert "archived=true" in every.split("<thead")[1].split("</thead>")[0]
    one = http.get(f"/campaigns/{first}").text
    assert "This campaign is archived" in one
    assert f'action="{URL}/{first}/restore"' in one
    assert "archive" not in http.get(f"/campaigns/{second}").text
    http.post(f"{URL}/{first}/restore")
    assert "archived campaigns" not in http.get("/").text
