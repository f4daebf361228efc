"""HTML from view data; everything is escaped unless a template is its author."""

import re
from collections.abc import Callable, Coroutine, Mapping
from contextvars import ContextVar
from datetime import UTC, datetime
from functools import cache
from os import PathLike, stat_result
from pathlib import Path
from typing import Any, NamedTuple

import jinja2
import msgspec
import numpy as np
from fastapi import Request
from markupsafe import Markup
from starlette.responses import FileResponse, HTMLResponse, Response
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Receive, Scope, Send

from eigenfail import __version__, plugins
from eigenfail.methods import traits_of
from eigenfail.presentation import figures
from eigenfail.presentation.tables import (
    Cell,
    FormattedCell,
    TableColumn,
    format_cell,
    format_cost,
)
from eigenfail.values.analysis import AnalysisState
from eigenfail.values.campaign import Campaign, CampaignState, state_word
from eigenfail.values.episode import ERRORED, Outcome
from eigenfail.values.summary import Summary
from eigenfail.wire.http import PREFIX, Problem
from eigenfail_services.export_formats import has_pyarrow

FOLDER = Path(__file__).parent


STATIC = FOLDER / "static"


CLUSTERERS = {
    "kmeans": "K-means",
    "gaussian_mixture": "Gaussian mixture",
    "hdbscan": "HDBSCAN",
}


IMPORTED = re.compile(r'(?:from|import) "\./(\w+\.js)"')


class Assets(StaticFiles):
    """Assets that browsers revalidate on each request: new pages must not load old scripts.

    An unchanged file is answered by its ETag alone.
    """

    def file_response(
        self,
        full_path: str | PathLike[str],
        stat_result: stat_result,
        scope: Scope,
        status_code: int = 200,
    ) -> Response:
        """Return the file, or the answer that it has not changed."""
        response = super().file_response(full_path, stat_result, scope, status_code)
        response.headers["Cache-Control"] = "no-cache"
        if isinstance(response, FileResponse):
            del response.headers["Accept-Ranges"]
            # The file is read in the event loop: it is small and in the system's cache. A page
            # loads a dozen or more, and a thread for each took half as long as making the page.
            return Response(Path(full_path).read_bytes(), status_code, response.headers)
        return response


def write_time(at_ms: int | None) -> str:
    """Return a time in UTC as HTML, which scripts show in the time zone of the browser."""
    # What has not happened yet has no time.
    if at_ms is None:
        return figures.UNKNOWN
    moment = datetime.fromtimestamp(at_ms // 1_000, UTC).replace(tzinfo=None)
    marked = Markup('<time datetime="{}Z">{}</time>')
    return marked.format(moment.isoformat(), figures.format_utc(at_ms))


DIGITS = 5
"""More digits would make pages larger, and no screen could show them."""


def round_array(array: object) -> object:
    """Return an array as plain values, floats with as many digits as a screen can show.

    Raises:
        TypeError: it is neither an array nor a number of numpy.
    """
    if isinstance(array, np.generic):
        return array.item()
    if not isinstance(array, np.ndarray):
        raise TypeError(f"{type(array).__name__} is not an array")
    if array.ndim > 1:
        return list(array)
    return [float(f"{value:.{DIGITS}g}") for value in array.tolist()]


_encoder = msgspec.json.Encoder(enc_hook=round_array)


def to_json(value: object) -> str:
    """Return a value as JSON for a data attribute.

    Arrays are rounded for the screen. A value that is not finite becomes null, because JSON cannot
    express it; it leaves a gap in the line of a chart.
    """
    return _encoder.encode(value).decode()


@cache
def join_charted_methods() -> str:
    """Return the names of the methods that have a `chart_mark`, by that mark, in one text."""
    marks = {name: traits_of(name).chart_mark for name in plugins.names(plugins.METHODS)}
    places = sorted((mark, name) for name, mark in marks.items() if mark is not None)
    return " ".join(name for _, name in places)


@cache
def list_modules(script: str) -> list[str]:
    """Return a script and all scripts that it imports, so that a browser can load them at once."""
    found, new = set[str](), {script}
    while new:
        found |= new
        texts = [(STATIC / "js" / name).read_text("utf-8") for name in new]
        new = {name for text in texts for name in IMPORTED.findall(text)} - found
    return sorted(found)


class NavigationEntry(NamedTuple):
    """A link in the head of every page.

    Attributes:
        title: text of the link, and title of the page to which it leads.
        address: address of that page.
    """

    title: str
    address: str


class CampaignFile(NamedTuple):
    """A file about a campaign, which the campaign's page offers among its files.

    Attributes:
        title: text of the link.
        note: format of the file, next to the link.
        address: address of the file, with `{campaign}` in the place of the campaign's id.
        is_button: whether it is a button next to the list of files, and not in the list.
        is_page: whether it is a page, which a browser shows and does not store.
        suits: returns whether a campaign has the file; absent if each has it.
    """

    title: str
    note: str
    address: str
    is_button: bool = False
    is_page: bool = False
    suits: Callable[[Campaign], bool] | None = None


class ForeignLinks(NamedTuple):
    """The links of an application's extensions, which follow the links of the core."""

    navigation: tuple[NavigationEntry, ...] = ()
    campaign_files: tuple[CampaignFile, ...] = ()


NO_LINKS = ForeignLinks()

_links: ContextVar[ForeignLinks] = ContextVar("links", default=NO_LINKS)


class LinkMiddleware:
    """Middleware: show the links of an application's extensions on its pages.

    Templates are shared by all applications of a process, which may have other extensions.
    """

    def __init__(self, app: ASGIApp, links: ForeignLinks) -> None:
        self._app = app
        self._links = links

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on."""
        before = _links.set(self._links)
        try:
            await self._app(scope, receive, send)
        finally:
            _links.reset(before)


FOREIGN_TEMPLATES: dict[str, jinja2.BaseLoader] = {}
"""Loaders of the templates of extensions, by package."""


def add_templates(package: str) -> None:
    """Make the templates of a package known as PACKAGE/FILE.

    The name of a core template does not contain a folder, so that no package can replace it.

    Raises:
        ImportError: the package cannot be imported.
        ValueError: the package does not have a folder `templates`.
    """
    FOREIGN_TEMPLATES.setdefault(package, jinja2.PackageLoader(package))


def page(template: str, view: object, status: int = 200, **more: Any) -> HTMLResponse:
    """Return a page, or a piece of one, which browsers do not keep since all of it may change."""
    html = TEMPLATES.get_template(template).render(view=view, **more)
    return HTMLResponse(html, status, {"Cache-Control": "no-store"})


Handler = Callable[[Request, Any], Coroutine[Any, Any, Response]]


Handlers = dict[int | type[Exception], Handler]


KEPT = ("allow", "retry-after", "content-security-policy")


KEPT_PREFIXES = ("x-", "referrer-")


def wrap_for_browsers(handlers: Handlers) -> Handlers:
    """Return the handlers, answering in HTML where HTML was requested."""
    return {kind: show_problems(handler) for kind, handler in handlers.items()}


def show_problems(handler: Handler) -> Handler:
    """Return a handler that answers browsers with a page instead of JSON."""

    async def handle(request: Request, error: Any) -> Response:
        response = await handler(request, error)
        return as_page(response) if wants_page(request) else response

    return handle


def wants_page(request: Request) -> bool:
    """Return whether the request accepts HTML; programs use the API or do not ask for HTML."""
    accepts = request.headers.get("accept", "")
    return "text/html" in accepts and not request.url.path.startswith(f"{PREFIX}/")


def as_page(response: Response) -> Response:
    """Return the page that shows a problem."""
    problem = msgspec.json.decode(response.body, type=Problem)
    shown_page = page("problem.html", problem, problem.status)
    # Security headers and Retry-After hold for the page as for the JSON.
    for name, value in response.headers.items():
        if name in KEPT or name.startswith(KEPT_PREFIXES):
            shown_page.headers[name] = value
    return shown_page


S = CampaignState


WORKING = frozenset({S.QUEUED, S.RUNNING})
"""States in which a campaign needs workers."""


class Badge(msgspec.Struct, frozen=True):
    """A word, a sign before it, and the tone of its colour."""

    word: str
    sign: str
    tone: str


CAMPAIGN_BADGES: Mapping[str, Badge] = {
    S.QUEUED: Badge("queued", "○", "waiting"),
    S.RUNNING: Badge("running", "▶", "active"),
    S.PAUSING: Badge("pausing", "‖", "waiting"),
    S.PAUSED: Badge("paused", "‖", "waiting"),
    S.CANCELLING: Badge("cancelling", "×", "waiting"),
    S.CANCELLED: Badge("cancelled", "×", "ended"),
    S.DONE: Badge("done", "✓", "good"),
    S.DEAD: Badge("dead", "!", "bad"),
    # Done, but not green: it has no result.
    ERRORED: Badge(ERRORED, "!", "bad"),
}
"""Badges of campaigns by `state_word`."""


ANALYSIS_BADGES = {
    AnalysisState.QUEUED: Badge("queued", "○", "waiting"),
    AnalysisState.RUNNING: Badge("running", "▶", "active"),
    AnalysisState.DONE: Badge("done", "✓", "good"),
    AnalysisState.FAILED: Badge("failed", "!", "bad"),
}


OUTCOME_BADGES = {
    Outcome.COLLISION: Badge("collision", "◆", "bad"),
    Outcome.VIOLATION: Badge("violation", "◇", "bad"),
    Outcome.SAFE: Badge("safe", "○", "good"),
    Outcome.ERRORED: Badge(ERRORED, "!", "waiting"),
}


UNRESOLVED_BADGE = Badge("unresolved", "◐", "waiting")
"""Badge of an episode that ended when braking could no longer avoid a collision."""


def make_outcome_badge(outcome: Outcome, *, is_unresolved: bool) -> Badge:
    """Return the badge of how an episode ended."""
    if outcome is Outcome.SAFE and is_unresolved:
        return UNRESOLVED_BADGE
    return OUTCOME_BADGES[outcome]


NOTHING_YET = ("no episode completed",)


class Tile(msgspec.Struct, frozen=True):
    """A figure and its basis.

    Attributes:
        figure: the figure, as a cell of a table holds it.
        notes: basis of the figure, each note on a line below it.
        remark: a sentence on how to read it; empty if there is nothing to say.
        mark: short form of the remark for tables; empty if tables show the remark itself.
        term: label of the definition next to the mark.
        unit: unit of the figure; "share" for a share of one, which is shown in percent.
    """

    figure: Cell
    notes: tuple[str, ...] = ()
    remark: str = ""
    mark: str = ""
    term: str = ""
    unit: str = ""

    @property
    def value(self) -> str:
        """Return the figure as text, with its unit."""
        # A sum over nothing is an integer, and is shown as what it sums.
        figure = float(self.figure) if self.unit and isinstance(self.figure, int) else self.figure
        text = format_cell(figure, TableColumn("", self.unit)).value
        return text if self.unit in {"", "share"} else figures.put_unit(text, self.unit)


NamedTile = tuple[str, Tile | FormattedCell]
Tiles = tuple[NamedTile, ...]


def describe_remaining(campaign: Campaign, summary: Summary) -> str:
    """Return the remaining time at the speed so far, or the number of episodes left unrun."""
    if campaign.counts.cancelled:
        return f"{figures.format_count(campaign.counts.cancelled)} not run"
    if campaign.state != "running" or not summary.episodes_per_s:
        return ""
    return f"about {figures.format_duration(campaign.counts.open / summary.episodes_per_s)} left"


def make_failure_tile(summary: Summary) -> Tile:
    """Return the tile of the number and share of failures."""
    rate = summary.failure_rate
    if rate is None:
        # The remark says why there is none.
        nothing_yet = () if summary.rate_remark else NOTHING_YET
        return Tile(figures.UNKNOWN, nothing_yet, summary.rate_remark, *mark_of(summary))
    share = format_cell(rate)
    notes = (share.line,) if rate.k else (share.value, *share.basis)
    value = f"{figures.format_count(rate.k)} of {figures.format_count(rate.n)}"
    return Tile(value, notes, summary.rate_remark, *mark_of(summary))


def mark_of(summary: Summary) -> tuple[str, str]:
    """Return the numbers of errored and unresolved episodes, and the label of the first kind."""
    counts = (
        (summary.errored.count, "errored", "Errored"),
        (summary.unresolved.count, "unresolved", "Unresolved"),
    )
    found = [(f"{figures.format_count(n)} {words}", label) for n, words, label in counts if n]
    return ", ".join(words for words, _ in found), found[0][1] if found else ""


def make_cost_tile(summary: Summary) -> Tile:
    """Return the tile of the cost per failure with its basis."""
    price, counts = format_cost(summary.cost), summary.counts
    n = "n = 0 in " if not counts.failures else "n = "
    basis = (
        (f"{n}{figures.format_count(counts.failures or counts.completed)}",)
        if counts.completed
        else ()
    )
    return Tile(price.value, (*basis, *price.notes))


FILTERS = {
    "integer": figures.format_count,
    "number": figures.format_number,
    "percent": figures.format_share,
    "duration": figures.format_duration,
    "cell": format_cell,
    "price": format_cost,
    "failure_tile": make_failure_tile,
    "cost_tile": make_cost_tile,
    "usd": figures.format_usd,
    "counted": figures.count_noun,
    "minus_signs": figures.put_minus_signs,
    "moment": write_time,
}


def make_environment() -> jinja2.Environment:
    """Return the environment of the templates with its filters and functions."""
    made = jinja2.Environment(
        loader=jinja2.ChoiceLoader(
            [jinja2.FileSystemLoader(FOLDER / "templates"), jinja2.PrefixLoader(FOREIGN_TEMPLATES)]
        ),
        autoescape=True,
        # A misspelt name in a template is an error of a test, not an empty place on a page.
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters.update(FILTERS, json=to_json)
    made.globals |= {
        "version": __version__,
        "clusterers": CLUSTERERS,
        "modules_of": list_modules,
        "charted_methods": join_charted_methods,
        "foreign_links": _links.get,
        "analysis_badges": ANALYSIS_BADGES,
        "campaign_badges": CAMPAIGN_BADGES,
        "state_word": state_word,
        "has_pyarrow": has_pyarrow,
    }
    return made


TEMPLATES = make_environment()


class Pager(NamedTuple):
    """The addresses of a page of a list and of its neighbours.

    Attributes:
        address: address of this page.
        newest: the address of the first page; None on it.
        older: the address of the next one, if there is one.
    """

    address: str
    newest: str | None
    older: str | None


def make_pager(address: str, before: int | None, following: int | None) -> Pager:
    """Return the pager of the page below a cursor, with the cursor of the next page."""
    return Pager(
        page_of(address, before),
        page_of(address, None) if before else None,
        page_of(address, following) if following else None,
    )


def page_of(address: str, before: int | None) -> str:
    """Return the address of a list from a cursor on."""
    return f"{address}?before={before}" if before else address
