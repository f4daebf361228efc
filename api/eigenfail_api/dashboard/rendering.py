"""HTML from view data; everything is escaped unless a template is its author."""

import re
from collections.abc import Callable, Coroutine, Mapping
from functools import cache
from os import PathLike, stat_result
from pathlib import Path
from typing import Any

import msgspec
from fastapi import Request
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from starlette.responses import HTMLResponse, Response
from starlette.staticfiles import StaticFiles
from starlette.types import Scope

from eigenfail import __version__, plugins
from eigenfail.methods import traits_of
from eigenfail.presentation.figures import (
    format_count,
    format_duration,
    format_number,
    format_share,
    format_utc,
)
from eigenfail.wire import http
from eigenfail.wire.http import PREFIX, Problem
from eigenfail_api.dashboard.glossary import find_term

FOLDER = Path(__file__).parent
STATIC = FOLDER / "static"

CLUSTERERS = {
    "kmeans": "K-means",
    "gaussian_mixture": "Gaussian mixture",
    "hdbscan": "HDBSCAN",
}

IMPORTED = re.compile(r'(?:from|import) "\./(\w+\.js)"')


class Assets(StaticFiles):
    """Files that browsers ask after every time: new pages must not meet scripts of an old release.

    An unchanged file is answered by its ETag alone.
    """

    def file_response(
        self,
        full_path: str | PathLike[str],
        stat_result: stat_result,
        scope: Scope,
        status_code: int = 200,
    ) -> Response:
        """The file, or that it has not changed."""
        response = super().file_response(full_path, stat_result, scope, status_code)
        response.headers["Cache-Control"] = "no-cache"
        return response


FILTERS = {
    "integer": format_count,
    "number": format_number,
    "percent": format_share,
    "duration": format_duration,
    "moment": format_utc,
}


def to_json(value: object) -> str:
    """JSON for a data attribute."""
    return http.encode(value).decode()


@cache
def list_charted_methods() -> str:
    """Return the names of the methods that declare their place in charts, in order."""
    marks = {name: traits_of(name).chart_mark for name in plugins.names(plugins.METHODS)}
    places = sorted((mark, name) for name, mark in marks.items() if mark is not None)
    return " ".join(name for _, name in places)


@cache
def modules_of(script: str) -> list[str]:
    """The scripts that one needs, itself included: a browser would find out bit by bit."""
    found, new = set[str](), {script}
    while new:
        found |= new
        texts = [(STATIC / "js" / name).read_text("utf-8") for name in new]
        new = {name for text in texts for name in IMPORTED.findall(text)} - found
    return sorted(found)


def environment() -> Environment:
    """Where the templates live, and what they can say."""
    made = Environment(
        loader=FileSystemLoader(FOLDER / "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters.update(FILTERS, json=to_json)
    made.globals |= {
        "version": __version__,
        "clusterers": CLUSTERERS,
        "modules_of": modules_of,
        "charted_methods": list_charted_methods,
        "term_of": find_term,
    }
    return made


TEMPLATES = environment()


def page(template: str, view: object, status: int = 200, **more: Any) -> HTMLResponse:
    """A page, or a piece of one; never kept by the browser, since all of it may change."""
    html = TEMPLATES.get_template(template).render(view=view, **more)
    return HTMLResponse(html, status, {"Cache-Control": "no-store"})


Handler = Callable[[Request, Any], Coroutine[Any, Any, Response]]
Handlers = Mapping[int | type[Exception], Handler]

KEPT = ("allow", "retry-after", "content-security-policy")
KEPT_PREFIXES = ("x-", "referrer-")


def for_browsers(handlers: Handlers) -> dict[int | type[Exception], Handler]:
    """The handlers, answering in HTML where HTML was asked for."""
    return {kind: show_problems(handler) for kind, handler in handlers.items()}


def show_problems(handler: Handler) -> Handler:
    """A handler whose problem a person can read."""

    async def handle(request: Request, error: Any) -> Response:
        response = await handler(request, error)
        return as_page(response) if wants_page(request) else response

    return handle


def wants_page(request: Request) -> bool:
    """Whether a person is looking; programs ask the API, or do not ask for HTML."""
    accepts = request.headers.get("accept", "")
    return "text/html" in accepts and not request.url.path.startswith(f"{PREFIX}/")


def as_page(response: Response) -> Response:
    """The page that says what a problem says."""
    problem = msgspec.json.decode(response.body, type=Problem)
    shown_page = page("problem.html", problem, problem.status)
    for name, value in response.headers.items():
        if name in KEPT or name.startswith(KEPT_PREFIXES):
            shown_page.headers[name] = value
    return shown_page
