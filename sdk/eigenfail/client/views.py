"""Saved views of a service: lists with their filter and order, which all users share."""

from collections.abc import Mapping, Sequence

from eigenfail.client.link import Link
from eigenfail.frames import Rows
from eigenfail.values import Page
from eigenfail.views import (
    SavedView,
    ViewName,
    ViewPage,
    ViewRequest,
    check_view,
    make_unknown_view_error,
    write_query,
)
from eigenfail.wire.http import read_fields

ViewLike = int | str | SavedView
"""A view: its id, its name, or the view."""


class Views:
    """Save, list, rename and delete views.

    `client.campaigns.list(**view.options)` and `client.episodes.list(campaign, **view.options)`
    list what a view shows. Changes need a key of the scope runner where keys are required. Every
    method raises ServiceUnreachable if no service answers.
    """

    def __init__(self, link: Link) -> None:
        self._link = link

    def save(
        self, name: str, page: ViewPage | str, /, **query: str | bool | Sequence[str]
    ) -> SavedView:
        """Save a view under a new name, and return it.

        Args:
            name: name of the view.
            page: list that the view shows: campaigns, episodes or failures.
            query: keyword arguments of that list, such as state, filter and sort.

        Raises:
            InvalidValue: the name is empty, or a filter or an order cannot be read.
            UnknownName: the list does not have an argument, or there is no such list.
            Conflict: a view has the name, or there are as many views as there may be.
        """
        return self._link.post("/views", SavedView, _make_request(name, page, query))

    def list(self, page: ViewPage | str | None = None) -> Rows[SavedView]:
        """List the views of a list, or of all lists, newest first.

        Args:
            page: campaigns, episodes or failures; None for all.
        """
        asked = {"page": None if page is None else str(page)}
        return self._link.pages("/views", Page[SavedView], "before", asked)

    def get(self, view: ViewLike) -> SavedView:
        """Return a view.

        Raises:
            NotFound: no such view.
        """
        if isinstance(view, str):
            found = self._link.get("/views", Page[SavedView], {"name": view}).items
            if not found:
                raise make_unknown_view_error(view)
            return found[0]
        number = view.id if isinstance(view, SavedView) else view
        return self._link.get(f"/views/{number}", SavedView)

    def change(self, view: ViewLike, **query: str | bool | Sequence[str]) -> SavedView:
        """Replace all parameters of a view, and return it.

        Raises:
            NotFound: no such view.
            InvalidValue: a filter or an order cannot be read.
            UnknownName: the list does not have an argument.
        """
        found = self.get(view)
        request = _make_request(found.name, found.page, query)
        return self._link.put(f"/views/{found.id}", SavedView, request)

    def rename(self, view: ViewLike, name: str) -> SavedView:
        """Give a view another name, and return it.

        Raises:
            NotFound: no such view.
            InvalidValue: the name is empty or too long.
            Conflict: another view has the name.
        """
        place = f"/views/{self.get(view).id}/name"
        return self._link.put(place, SavedView, read_fields({"name": name}, ViewName))

    def delete(self, view: ViewLike) -> SavedView:
        """Delete a view, and return it as it was; what it lists stays.

        Raises:
            NotFound: no such view.
        """
        return self._link.delete(f"/views/{self.get(view).id}", SavedView)


def _make_request(name: str, page: ViewPage | str, query: Mapping[str, object]) -> ViewRequest:
    given = {"name": name, "page": page, "query": write_query(query)}
    return check_view(read_fields(given, ViewRequest))
