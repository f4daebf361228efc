"""Migration 0027: saved views; campaigns stay without them."""

from sqlalchemy import inspect
from store_checks.modes import crashed

from eigenfail.views import ViewPage, ViewRequest
from eigenfail_services.store import migrate, open_store


def tables(connection) -> set[str]:
    return set(inspect(connection).get_table_names())


def test_a_downgrade_takes_the_views_alone(url, look) -> None:
    store = open_store(url)
    campaign = crashed(store)
    request = ViewRequest("hard", ViewPage.EPISODES, {"sort": "-severity"})
    store.views.create(request, "anna")
    digest = store.episodes.digest(campaign.id)
    store.close()
    migrate.downgrade(url, "0025")
    assert "saved_views" not in look(url, tables)
    store = open_store(url)  # brings the schema up again
    assert store.views.page(9).items == ()
    assert store.views.create(request, "anna").query == request.query
    assert store.episodes.digest(campaign.id) == digest
    store.close()
