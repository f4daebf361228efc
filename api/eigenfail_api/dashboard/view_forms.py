"""Saved views on the lists of campaigns, episodes and failures: the menu, and its forms.

The forms work without JavaScript: each leads to the list with the filter and order of the view.
"""

from collections.abc import Iterable, Mapping
from urllib.parse import parse_qsl, urlencode

import msgspec
from fastapi import APIRouter
from fastapi.responses import RedirectResponse

from eigenfail.errors import InvalidValue
from eigenfail.views import (
    LONGEST_NAME,
    SavedView,
    ViewPage,
    ViewRequest,
    check_view,
    check_view_name,
)
from eigenfail.wire.http import read_fields
from eigenfail_api.dashboard.rendering import write_time
from eigenfail_api.dashboard.triage_forms import MOST_FIELDS, SEE_OTHER, Form
from eigenfail_api.parameters import CallerName, Stored
from eigenfail_api.routes.views import ViewId

LISTS = {
    ViewPage.CAMPAIGNS: "/",
    ViewPage.EPISODES: "/campaigns/{campaign}/episodes",
    ViewPage.FAILURES: "/failures",
}
"""Addresses of the lists that views show."""

ON_NO_PAGE = frozenset({"fields"})
"""Parameters that the command line has, but no page."""


UNOWNED = {"unowned": "true"}
"""Parameter of the page of failures for those without an owner.

The field `owner` of its form is empty where the owner does not matter.
"""


class ViewLine(msgspec.Struct, frozen=True):
    """A view in the menu.

    Attributes:
        address: the list as the view shows it.
        is_current: whether the page shows it now.
        saved: when it was saved.
    """

    id: int
    name: str
    address: str
    is_current: bool
    author: str
    saved: str


class ViewMenu(msgspec.Struct, frozen=True, kw_only=True):
    """The menu of the views of a list.

    Attributes:
        lines: the views in alphabetical order.
        page: the list.
        query: parameters of the list as it is shown, as in its address.
        campaign: the campaign whose episodes are listed; None on other lists.
    """

    lines: tuple[ViewLine, ...]
    page: str
    query: str
    campaign: int | None
    longest: int = LONGEST_NAME


def make_view_menu(
    views: Iterable[SavedView],
    page: ViewPage,
    query: Mapping[str, str],
    campaign: int | None = None,
) -> ViewMenu:
    """Return the menu of the views of a list, which is shown with some parameters."""
    shown = {name: value for name, value in query.items() if value}
    return ViewMenu(
        lines=tuple(
            ViewLine(
                id=view.id,
                name=view.name,
                address=_find_address(page, view.query, campaign),
                is_current=_to_page_query(view.query) == shown,
                author=view.author,
                saved=write_time(view.saved_ms),
            )
            for view in views
        ),
        page=page.value,
        query=urlencode(shown),
        campaign=campaign,
    )


def _find_address(page: ViewPage, query: Mapping[str, str], campaign: int | None) -> str:
    shown = _to_page_query(query)
    path = LISTS[page].format(campaign=campaign)
    return f"{path}?{urlencode(shown)}" if shown else path


def _to_page_query(query: Mapping[str, str]) -> dict[str, str]:
    """Return the parameters of a view as the address of the page has them."""
    shown = {name: value for name, value in query.items() if value and name not in ON_NO_PAGE}
    return shown | UNOWNED if query.get("owner") == "" else shown


router = APIRouter(include_in_schema=False)


@router.post("/views")
def save_view(store: Stored, form: Form, who: CallerName) -> RedirectResponse:
    """Save filter, order and columns of the list under a new name."""
    query = _parse_query(form.get("query", ""))
    given = {"name": form.get("name", ""), "page": form.get("page"), "query": query}
    request = check_view(read_fields(given, ViewRequest))
    campaign = _read_campaign(form, request.page)
    return _return_to(store.views.create(request, who), campaign)


@router.post("/views/{view}/name")
def rename_view(store: Stored, view: ViewId, form: Form, who: CallerName) -> RedirectResponse:
    """Give a view another name."""
    campaign = _read_campaign(form, store.views.get(view).page)
    name = check_view_name(form.get("name", ""))
    return _return_to(store.views.rename(view, name, who), campaign)


@router.post("/views/{view}/delete")
def delete_view(store: Stored, view: ViewId, form: Form) -> RedirectResponse:
    """Delete a view."""
    campaign = _read_campaign(form, store.views.get(view).page)
    return _return_to(store.views.delete(view), campaign)


def _parse_query(text: str) -> dict[str, str]:
    """Return the parameters of a view from those of a page's address."""
    try:
        query = dict(parse_qsl(text, max_num_fields=MOST_FIELDS))
    except ValueError:
        problem = f"it has more than {MOST_FIELDS} parameters."
        raise InvalidValue("query", problem, "Open the list again.") from None
    named = {name: value for name, value in query.items() if name not in UNOWNED}
    return named if named == query else named | {"owner": ""}


def _read_campaign(form: Mapping[str, str], page: ViewPage) -> int | None:
    """Return the campaign whose list of episodes a form is on; None on other lists."""
    text = form.get("campaign", "")
    if page is not ViewPage.EPISODES:
        return None
    if not text.isdecimal() or not text.isascii() or len(text) > len(str(2**63)):
        raise InvalidValue("campaign", "the id of the campaign is missing.", "Open the list again.")
    return int(text)


def _return_to(view: SavedView, campaign: int | None) -> RedirectResponse:
    return RedirectResponse(_find_address(view.page, view.query, campaign), SEE_OTHER)
