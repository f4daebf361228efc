"""Saved views: lists with their filter and order, under names that all users share."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import msgspec
from sqlalchemy import Connection, RowMapping, delete, func, insert, select, update
from sqlalchemy.exc import IntegrityError

from eigenfail.errors import Conflict
from eigenfail.values import Page
from eigenfail.views import (
    MAX_VIEWS,
    SavedView,
    ViewPage,
    ViewRequest,
    make_unknown_view_error,
)
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.engine import Database
from eigenfail_services.store.schema import saved_views


class ViewStore:
    """Saved views, no two of them with one name."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def create(self, request: ViewRequest, author: str) -> SavedView:
        """Save a view under a new name.

        Raises:
            Conflict: a view has the name, or there are as many as there may be.
        """
        made = insert(saved_views).values(_list_values(request, author)).returning(saved_views)
        with self._claiming(request.name) as connection:
            count = connection.execute(select(func.count()).select_from(saved_views)).scalar_one()
            if count >= MAX_VIEWS:
                raise Conflict(
                    f"There are {count} views, and a service has at most {MAX_VIEWS}.",
                    "Delete one that is no longer needed: `eigenfail view delete NAME`.",
                )
            _refuse_taken_name(connection, request.name)
            return _to_view(connection.execute(made).mappings().one())

    def get(self, view: int) -> SavedView:
        """Return a view.

        Raises:
            NotFound: no such view.
        """
        with self._database.reading() as connection:
            return _read_view(connection, view)

    def page(
        self,
        limit: int,
        before: int | None = None,
        of: ViewPage | None = None,
        name: str | None = None,
    ) -> Page[SavedView]:
        """Return views, newest first.

        Args:
            limit: maximum number of views.
            before: only ids below this one.
            of: only views of this list.
            name: only the view with this name.
        """
        query = select(saved_views).order_by(saved_views.c.id.desc()).limit(limit + 1)
        if before is not None:
            query = query.where(saved_views.c.id < before)
        if of is not None:
            query = query.where(saved_views.c.page == of.value)
        if name is not None:
            query = query.where(saved_views.c.name == name)
        with self._database.reading() as connection:
            found = tuple(map(_to_view, connection.execute(query).mappings()))
        return Page(found[:limit], found[limit - 1].id if len(found) > limit else None)

    def list_by_name(self, of: ViewPage) -> tuple[SavedView, ...]:
        """Return all views of a list in alphabetical order."""
        found = self.page(MAX_VIEWS, of=of).items
        return tuple(sorted(found, key=lambda view: (view.name.casefold(), view.id)))

    def change(self, view: int, request: ViewRequest, author: str) -> SavedView:
        """Replace name, list and parameters of a view, and return it.

        Raises:
            NotFound: no such view.
            Conflict: another view has the name.
        """
        return self._update(view, _list_values(request, author))

    def rename(self, view: int, name: str, author: str) -> SavedView:
        """Give a view another name, without a change of its list and parameters, and return it.

        Raises:
            NotFound: no such view.
            Conflict: another view has the name.
        """
        return self._update(view, {"name": name, "author": author, "saved_ms": now_ms()})

    def _update(self, view: int, values: dict[str, Any]) -> SavedView:
        change = update(saved_views).where(saved_views.c.id == view)
        changed = change.values(values).returning(saved_views)
        with self._claiming(values["name"]) as connection:
            _refuse_taken_name(connection, values["name"], view)
            found = connection.execute(changed).mappings().one_or_none()
        if found is None:
            raise make_unknown_view_error(view)
        return _to_view(found)

    def delete(self, view: int) -> SavedView:
        """Delete a view, and return it as it was.

        Raises:
            NotFound: no such view.
        """
        taken = delete(saved_views).where(saved_views.c.id == view).returning(saved_views)
        with self._database.writing() as connection:
            found = connection.execute(taken).mappings().one_or_none()
        if found is None:
            raise make_unknown_view_error(view)
        return _to_view(found)

    @contextmanager
    def _claiming(self, name: str) -> Iterator[Connection]:
        try:
            with self._database.writing() as connection:
                yield connection
        except IntegrityError:  # another request took the name at the same time
            raise _make_taken_error(name) from None


def _list_values(request: ViewRequest, author: str) -> dict[str, Any]:
    return {
        "name": request.name,
        "page": request.page.value,
        "query": msgspec.json.encode(request.query).decode(),
        "author": author,
        "saved_ms": now_ms(),
    }


def _read_view(connection: Connection, view: int) -> SavedView:
    query = select(saved_views).where(saved_views.c.id == view)
    found = connection.execute(query).mappings().one_or_none()
    if found is None:
        raise make_unknown_view_error(view)
    return _to_view(found)


def _refuse_taken_name(connection: Connection, name: str, but: int = 0) -> None:
    query = select(saved_views.c.id).where(saved_views.c.name == name, saved_views.c.id != but)
    if connection.execute(query).scalar_one_or_none() is not None:
        raise _make_taken_error(name)


def _make_taken_error(name: str) -> Conflict:
    problem = f"A view with the name '{name}' exists."
    return Conflict(problem, "Choose another name, or delete that view first.")


def _to_view(found: RowMapping) -> SavedView:
    values: dict[str, Any] = dict(found)
    query = msgspec.json.decode(values.pop("query"), type=dict[str, str])
    return SavedView(page=ViewPage(values.pop("page")), query=query, **values)
