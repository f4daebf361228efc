"""The page that launches a suite from its file, after a preview of its campaigns."""

import tomllib
from collections.abc import Iterator, Mapping

import msgspec
from anyio.to_thread import run_sync
from fastapi import APIRouter, Depends, Request
from fastapi.responses import HTMLResponse

from eigenfail.errors import InputError, InvalidValue
from eigenfail.presentation.figures import count_noun
from eigenfail.suites import SuiteRequest
from eigenfail.wire.http import read_body
from eigenfail_api.concurrency import ConcurrencyLimit
from eigenfail_api.dashboard import launch_page
from eigenfail_api.dashboard.rendering import page
from eigenfail_api.dashboard.suites_page import make_suite_address
from eigenfail_api.parameters import Stored, read_form
from eigenfail_services.campaigns.suites import check_suite, read_suite
from eigenfail_services.store import Store

router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)

PATH = "/launch/suite"


@router.get(PATH)
def show_new_suite() -> HTMLResponse:
    """Serve the page without a file."""
    return page("new_suite.html", {"text": ""})


FORMS = Depends(ConcurrencyLimit("forms of suites"), scope="function")


@router.post(PATH, dependencies=[FORMS])
async def preview_new_suite(request: Request, store: Stored) -> HTMLResponse:
    """Serve the preview of a file; nothing is launched."""
    typed = await read_form(request, launch_page.MOST_FIELDS)
    return page(
        "new_suite.html", await run_sync(preview_suite, store, typed.get(launch_page.TOML, ""))
    )


def preview_suite(store: Store, text: str) -> dict[str, object]:
    """Return what the page shows of a file: its suite, or why there is none."""
    try:
        body = encode_suite(text)
        suite = read_suite(read_body(body, SuiteRequest))
        problems = check_suite(store, suite).problems
    except InputError as error:
        return {"text": text, "troubles": [launch_page.LaunchTrouble(describe_problem(error))]}
    return {
        "text": text,
        "troubles": list(list_member_troubles(problems)),
        "suite": suite,
        "refused": frozenset(problems),
        "body": body.decode(),
        # The same file has the same key, so that a second click launches nothing.
        "key": "" if problems else launch_page.make_key("", msgspec.json.decode(body)),
        "address": make_suite_address(suite.name),
    }


def encode_suite(text: str) -> bytes:
    """Return the file of a suite as the body of the request that creates it.

    Raises:
        InvalidValue: the text is not TOML, or describes a campaign.
    """
    try:
        table = tomllib.loads(text)
        body = msgspec.json.encode(table)
    # A number of too many digits is a plain ValueError.
    except (ValueError, RecursionError) as error:
        raise InvalidValue("", f"The file is not TOML: {error}.") from None
    if "method" in table:
        remedy = "Fill in the launch form from it."
        raise InvalidValue("", "The file describes a campaign, not a suite.", remedy)
    return body


def list_member_troubles(problems: Mapping[str, InputError]) -> Iterator[launch_page.LaunchTrouble]:
    """Yield each problem once, with the first member that has it and the number of others."""
    named: dict[str, list[str]] = {}
    for name, error in problems.items():
        named.setdefault(describe_problem(error), []).append(name)
    for words, names in named.items():
        more = f" and {count_noun(len(names) - 1, 'other')}" if len(names) > 1 else ""
        yield launch_page.LaunchTrouble(f"{names[0]}{more}: {words}")


def describe_problem(error: InputError) -> str:
    """Return a problem with its field and its remedy."""
    where = f"{error.field}: " if error.field else ""
    return f"{where}{launch_page.describe_error(error)}"
