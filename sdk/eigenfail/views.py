"""Saved views: a list with its filter, order and columns, under a name that all users share.

A view has the parameters of its list as texts, as the address of the list has them. None of it
enters a digest.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from enum import StrEnum
from typing import Annotated, Any

import msgspec

from eigenfail.errors import InvalidValue, NotFound, UnknownName
from eigenfail.filters import parse_campaign_sort, parse_fields, parse_filter, parse_sort
from eigenfail.values import CampaignState
from eigenfail.values.failures import parse_failure_sort
from eigenfail.values.showing import Tabular
from eigenfail.values.triage import TriageState

LONGEST_NAME = 80
LONGEST_PARAMETER = 2_000
MAX_VIEWS = 500
"""Views of one service: pages show all views of their list."""

TRUE = "true"


class ViewPage(StrEnum):
    """List that a view shows.

    `campaigns`: the list of campaigns. `episodes`: the list of the episodes of a campaign; a view
    of it opens with any campaign. `failures`: the list of the failures of all campaigns.
    """

    CAMPAIGNS = "campaigns"
    EPISODES = "episodes"
    FAILURES = "failures"


_Name = Annotated[str, msgspec.Meta(min_length=1, max_length=LONGEST_NAME)]
_Parameter = Annotated[str, msgspec.Meta(max_length=LONGEST_PARAMETER)]


class ViewRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A view that is to be saved.

    Attributes:
        name: name of the view, which no other view has.
        page: list that the view shows: campaigns, episodes or failures.
        query: parameters of the list, as in its address: filter, order, columns.
    """

    name: _Name
    page: ViewPage
    query: dict[str, _Parameter] = {}


class ViewName(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The name that a view is to have, which no other view has."""

    name: _Name


class SavedView(Tabular, msgspec.Struct, frozen=True):
    """A saved view.

    Attributes:
        id: number of the view.
        name: name of the view.
        page: list that the view shows: campaigns, episodes or failures.
        query: parameters of the list, as in its address.
        author: name of the key that saved the view last; `loopback` or `network` where no key is
            required.
        saved_ms: when the view was saved last. [ms since 1970]
    """

    id: int
    name: str
    page: ViewPage
    query: dict[str, str]
    author: str
    saved_ms: int

    @property
    def options(self) -> dict[str, Any]:
        """Keyword arguments of the list in Python: `client.campaigns.list(**view.options)`."""
        return {name: _OPTIONS.get(name, str)(value) for name, value in self.query.items()}


def _read_flag(text: str) -> bool:
    return text == TRUE


_OPTIONS: dict[str, Callable[[str], Any]] = {"archived": _read_flag, "fields": parse_fields}
"""How parameters that are no text in Python are read."""


def _check_text(_field: str, text: str) -> None:
    if not text.isprintable():
        raise InvalidValue("query", "a value contains a character that cannot be printed.")


def _check_flag(field: str, text: str) -> None:
    if text != TRUE:
        raise InvalidValue(field, f"'{text}' is not a valid value.", f"Write {TRUE}, or omit it.")


def _check_choice(choices: Iterable[str]) -> Callable[[str, str], None]:
    known = tuple(choices)

    def check(field: str, text: str) -> None:
        if text not in known:
            raise UnknownName(field, text, known)

    return check


def _check_parsed(parse: Callable[[str], object]) -> Callable[[str, str], None]:
    def check(_field: str, text: str) -> None:
        parse(text)

    return check


_LABELS = dict.fromkeys(("project", "planner_version"), _check_text)
_ANY_CAMPAIGN = {**_LABELS, "method": _check_text, "archived": _check_flag}

PARAMETERS: Mapping[ViewPage, Mapping[str, Callable[[str, str], None]]] = {
    ViewPage.CAMPAIGNS: {
        **_ANY_CAMPAIGN,
        **dict.fromkeys(("search", "suite", "tag"), _check_text),
        "state": _check_choice(CampaignState),
        "sort": _check_parsed(parse_campaign_sort),
    },
    ViewPage.EPISODES: {
        "filter": _check_parsed(parse_filter),
        "sort": _check_parsed(parse_sort),
        "fields": _check_parsed(parse_fields),
    },
    ViewPage.FAILURES: {
        **_ANY_CAMPAIGN,
        **dict.fromkeys(("planner", "owner"), _check_text),
        "state": _check_choice(TriageState),
        "sort": _check_parsed(parse_failure_sort),
    },
}
"""Parameters of each list, with the check of a value under its field; it raises InputError."""


EMPTY_ASKS = frozenset({"owner"})
"""Parameters whose empty text asks for something: failures without an owner."""


def check_view(request: ViewRequest) -> ViewRequest:
    """Return a view without white space around its texts, and without empty parameters.

    An empty owner stays: it asks for failures without one.

    Raises:
        UnknownName: the list does not have a parameter, or a parameter never has the value.
        InvalidValue: the name is empty, or a value cannot be read: the error names the field.
    """
    return msgspec.structs.replace(
        request,
        name=check_view_name(request.name),
        query=_check_query(request.page, request.query),
    )


def check_view_name(text: str) -> str:
    """Return the name of a view without white space around it.

    Raises:
        InvalidValue: it is empty, too long, or has a character that cannot be printed.
    """
    tidy = " ".join(text.split())
    if not tidy or len(tidy) > LONGEST_NAME or not tidy.isprintable():
        problem = "it is empty, too long, or contains a character that cannot be printed."
        raise InvalidValue("name", problem, f"Write up to {LONGEST_NAME} characters.")
    return tidy


def _check_query(page: ViewPage, given: Mapping[str, str]) -> dict[str, str]:
    checks = PARAMETERS[page]
    for name in given:
        if name not in checks:
            raise UnknownName("query", name, checks)
    tidy = {name: text.strip() for name, text in given.items()}
    query = {name: text for name, text in tidy.items() if text or name in EMPTY_ASKS}
    for name, text in query.items():
        checks[name](f"query.{name}", text)
    return query


def write_query(given: Mapping[str, object]) -> dict[str, str]:
    """Return arguments of a list as parameters, without those that are empty, False or None.

    An empty owner stays, as in `check_view`.

    Raises:
        InvalidValue: a value is neither a text, nor True, nor a sequence of texts.
    """
    return {
        name: _write_value(name, value)
        for name, value in given.items()
        if value or (value == "" and name in EMPTY_ASKS)
    }


def _write_value(name: str, value: object) -> str:
    if isinstance(value, str):
        return str(value)
    if value is True:
        return TRUE
    if isinstance(value, Sequence) and all(isinstance(each, str) for each in value):
        return ",".join(value)
    raise InvalidValue(name, f"{value!r} is not a text.", "Write it as in the address of the list.")


def make_unknown_view_error(view: int | str) -> NotFound:
    """Return the error that no view has an id or a name."""
    words = f"'{view}'" if isinstance(view, str) else str(view)
    return NotFound(f"View {words} does not exist.", "`eigenfail view list` lists them.")


def require_page(view: SavedView, page: ViewPage) -> SavedView:
    """Return a view of a list.

    Raises:
        InvalidValue: the view is of another list.
    """
    if view.page is not page:
        problem = f"View '{view.name}' is of the list of {view.page.value}, not of {page.value}."
        remedy = f"`eigenfail view list --page {page.value}` lists those of {page.value}."
        raise InvalidValue("view", problem, remedy)
    return view
