"""Saved views by the client: they give the arguments of lists."""

import pytest
from store_checks.failures import fill

from eigenfail.errors import Conflict, InvalidValue, NotFound, UnknownName
from eigenfail.views import ViewPage, ViewRequest


def test_a_view_gives_the_arguments_of_its_list(client, store):
    fill(store)
    view = client.views.save(
        "hard", "episodes", filter="severity > 2", sort="-severity", fields=["index", "severity"]
    )
    assert view.query["fields"] == "index,severity"
    rows = client.episodes.list(1, **view.options)
    assert [row["severity"] for row in rows] == [99.0, 4.0, 3.0]
    store.campaigns.archive(2)
    view = client.views.save("all", ViewPage.CAMPAIGNS, archived=True, sort="id", method="")
    assert view.query == {"archived": "true", "sort": "id"}
    assert [each.id for each in client.campaigns.list(**view.options)] == [1, 2, 3, 4]
    view = client.views.save("idm", "failures", planner="idm", archived=True)
    found = client.episodes.list_failures(**view.options)
    assert {row.campaign for row in found} == {2, 4}
    assert [row.severity for row in found] == sorted((row.severity for row in found), reverse=True)
    view = client.views.save("unowned", "failures", owner="", planner="")
    assert view.options == {"owner": ""}


def test_views_are_found_by_id_name_and_themselves(client):
    made = client.views.save("a", "campaigns")
    other = client.views.save("7", "failures", state="new")
    assert client.views.get(made.id) == client.views.get("a") == client.views.get(made) == made
    assert client.views.get("7") == other
    assert list(client.views.list()) == [other, made]
    assert list(client.views.list("campaigns")) == [made]
    assert client.views.rename("a", "b").name == "b"
    assert client.views.change("b", state="done").query == {"state": "done"}
    assert client.views.delete(made.id).name == "b"
    for view in ("b", made.id, made):
        with pytest.raises(NotFound):
            client.views.get(view)


def test_what_cannot_be_is_refused(client):
    client.views.save("a", "campaigns")
    with pytest.raises(Conflict):
        client.views.save("a", "episodes")
    with pytest.raises(InvalidValue, match="filter, character"):
        client.views.save("b", "episodes", filter="severity >")
    with pytest.raises(UnknownName, match="staet"):
        client.views.save("b", "campaigns", staet="done")
    with pytest.raises(InvalidValue, match="page"):
        client.views.save("b", "modes")
    with pytest.raises(InvalidValue, match="archived"):
        client.views.save("b", "campaigns", archived=3)
    with pytest.raises(UnknownName, match="sort"):
        client.episodes.list_failures(sort="steps")


def test_a_view_is_not_asked_for_what_it_does_not_have(client, store):
    request = ViewRequest("plain", ViewPage.EPISODES)
    assert store.views.create(request, "anna").options == {}
    assert client.views.get("plain").options == {}
