"""Checks of saved views: each has a name of its own, and is as it was saved."""

from threading import Thread

from msgspec.structs import replace

from eigenfail.errors import Conflict, NotFound
from eigenfail.testing import expect, expect_error
from eigenfail.values import Page
from eigenfail.views import MAX_VIEWS, SavedView, ViewPage, ViewRequest
from eigenfail_services.store import Store
from store_checks.examples import BEYOND, equal

HARD = ViewRequest("härter", ViewPage.EPISODES, {"filter": "label = 'a\"b'", "sort": "-severity"})
CLERKS = 8


def keeps_views(store: Store) -> None:
    """A view is listed under its list and its name until it is deleted."""
    made = store.views.create(HARD, "anna's key")
    told = (made.name, made.page, made.query, made.author)
    equal(told, (HARD.name, HARD.page, HARD.query, "anna's key"), "The view")
    equal(store.views.get(made.id), made, "The view, asked for")
    other = store.views.create(ViewRequest("Brakes", ViewPage.CAMPAIGNS), "ben")
    last = store.views.create(ViewRequest("Zebra", ViewPage.EPISODES), "ben")
    equal(store.views.page(2), Page((last, other), other.id), "The newest two")
    equal(store.views.page(2, other.id), Page((made,)), "The ones behind them")
    equal(store.views.page(9, of=ViewPage.CAMPAIGNS).items, (other,), "Views of campaigns")
    equal(store.views.page(9, name="Zebra").items, (last,), "By name")
    equal(store.views.page(9, name="zebra\x00").items, (), "By a name that no view has")
    listed = [view.name for view in store.views.list_by_name(ViewPage.EPISODES)]
    equal(listed, ["härter", "Zebra"], "Views of episodes by name")
    equal(store.views.delete(made.id), made, "The deleted view")
    equal(store.views.page(9).items, (last, other), "What is left")
    for stranger in (made.id, *BEYOND):
        for act in (store.views.get, store.views.delete):
            with expect_error(NotFound, f"View {stranger} was found."):
                act(stranger)


def changes_views(store: Store) -> None:
    """A change replaces all of a view, unless another one has the name."""
    made, other = (store.views.create(replace(HARD, name=name), "anna") for name in ("a", "b"))
    changed = store.views.change(made.id, ViewRequest("c", ViewPage.FAILURES, {}), "ben")
    equal(
        replace(changed, saved_ms=0),
        SavedView(made.id, "c", ViewPage.FAILURES, {}, "ben", 0),
        "The changed view",
    )
    equal(store.views.change(other.id, replace(HARD, name="b"), "anna").id, other.id, "Same name")
    for act in (
        lambda: store.views.change(made.id, replace(HARD, name="b"), "ben"),
        lambda: store.views.create(replace(HARD, name="b"), "ben"),
    ):
        with expect_error(Conflict, "Two views have one name."):
            act()
    equal(store.views.get(made.id), changed, "The view after a refusal")
    renamed = store.views.rename(other.id, "d", "ben")
    told = (renamed.name, renamed.page, renamed.query, renamed.author)
    equal(told, ("d", HARD.page, HARD.query, "ben"), "The renamed view")
    equal(store.views.get(other.id), renamed, "The renamed view, asked for")
    with expect_error(Conflict, "Two views have one name after a renaming."):
        store.views.rename(other.id, "c", "ben")
    with expect_error(NotFound, "A view that is not there was renamed."):
        store.views.rename(999, "e", "ben")
    with expect_error(NotFound, "A view that is not there was changed."):
        store.views.change(999, HARD, "ben")


def gives_a_name_once(store: Store) -> None:
    """Of requests at the same time for one name, one is carried out."""
    refused: list[Conflict] = []

    def save() -> None:
        try:
            store.views.create(HARD, "anna")
        except Conflict as error:
            refused.append(error)

    clerks = [Thread(target=save) for _ in range(CLERKS)]
    for clerk in clerks:
        clerk.start()
    for clerk in clerks:
        clerk.join()
    equal((len(refused), len(store.views.page(9).items)), (CLERKS - 1, 1), "Refusals and views")


def bounds_views(store: Store) -> None:
    """There are at most so many."""
    for number in range(MAX_VIEWS):
        store.views.create(replace(HARD, name=str(number)), "anna")
    with expect_error(Conflict, "There are too many views."):
        store.views.create(HARD, "anna")
    expect(store.views.page(1).items[0].name == str(MAX_VIEWS - 1), "The last view is another.")


CHECKS = (keeps_views, changes_views, gives_a_name_once, bounds_views)
