"""From view data to HTML; everything is escaped unless a template is its author."""

import re
from functools import cache
from os import PathLike, stat_result
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from starlette.responses import HTMLResponse, Response
from starlette.staticfiles import StaticFiles
from starlette.types import Scope

from eigenfail import __version__
from eigenfail.glossary import term_of
from eigenfail.wire import http
from eigenfail_api.dashboard import formats
from eigenfail_api.dashboard.views.lists import CLUSTERERS

FOLDER = Path(__file__).parent
STATIC = FOLDER / "static"

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
    "integer": formats.integer,
    "number": formats.number,
    "percent": formats.percent,
    "duration": formats.duration,
    "moment": formats.moment,
}


def to_json(value: object) -> str:
    """JSON for a data attribute."""
    return http.encode(value).decode()


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
        "term_of": term_of,
    }
    return made


TEMPLATES = environment()


def page(template: str, view: object, status: int = 200, **more: Any) -> HTMLResponse:
    """A page, or a piece of one; never kept by the browser, since all of it may change."""
    html = TEMPLATES.get_template(template).render(view=view, **more)
    return HTMLResponse(html, status, {"Cache-Control": "no-store"})
