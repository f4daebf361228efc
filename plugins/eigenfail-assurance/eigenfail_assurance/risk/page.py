"""The risk page: a question as TOML, and its answer from the campaigns that are stored."""

from urllib.parse import parse_qsl

import msgspec
from anyio.to_thread import run_sync
from fastapi import APIRouter, HTTPException, Request
from fastapi.responses import HTMLResponse

from eigenfail.errors import InputError, NotFound
from eigenfail.files import parse_toml
from eigenfail.presentation.tables import Table
from eigenfail.settings import convert
from eigenfail_api.dashboard.rendering import page
from eigenfail_api.parameters import Stored, read_within
from eigenfail_api.routes.analyses import COMPARISONS
from eigenfail_assurance.risk.assessment import RiskAssessment, RiskVerdict
from eigenfail_assurance.risk.campaigns import assess_campaigns
from eigenfail_assurance.risk.question import LIKE_RISK, RiskQuestion
from eigenfail_assurance.risk.sentences import (
    describe_allocation,
    describe_verdict,
    list_limits,
    list_tables,
)
from eigenfail_services.store.store import Store

QUESTION = "question"
TEMPLATE = "eigenfail_assurance/risk.html"

EXAMPLE = """name = "Motorway"
severity = [25.0, 100.0]  # thresholds between classes [m²/s²]

[target]
per_hour = 1e-3  # or per_million_km

[exposure]
hours = 1200.0
kilometres = 96000.0

[[scenarios]]
name = "cut-in"
encounters = 340  # in these hours
campaigns = [1]  # ids or names
"""
"""A question as a file. Its exposure is made up, so that the form does not begin with it."""

MARKS = {
    RiskVerdict.MET: "is-distinct",
    RiskVerdict.NOT_MET: "is-doubtful",
    RiskVerdict.UNDECIDED: "",
}

HTTP_REFUSED = 422


class RiskView(msgspec.Struct, frozen=True, kw_only=True):
    """The page.

    Attributes:
        typed: the question as it was typed; empty before one was.
        problem: why the question has no answer; empty otherwise.
        verdict: the verdict as a sentence; empty without an answer.
        mark: class of the verdict's style.
        tables: totals, scenarios and classes of severity.
        allocation: best use of the next episodes; None without an answer.
        sentences: sentences on that use.
        limits: what limits the answer.
        example: a question, to be read.
    """

    typed: str = ""
    problem: str = ""
    verdict: str = ""
    mark: str = ""
    tables: tuple[Table, ...] = ()
    allocation: Table | None = None
    sentences: tuple[str, ...] = ()
    limits: tuple[str, ...] = ()
    example: str = EXAMPLE


router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)


@router.get("/risk")
def show_risk() -> HTMLResponse:
    """Serve the empty form, and an example of a file."""
    return page(TEMPLATE, RiskView())


@router.post("/risk", dependencies=[COMPARISONS])
async def show_assessment(request: Request, store: Stored) -> HTMLResponse:
    """Serve the form with the answer to its question; nothing is stored."""
    body = await read_within(request)
    try:
        typed = dict(parse_qsl(body.decode(), keep_blank_values=True, max_num_fields=1))
    except ValueError as error:
        raise HTTPException(400, f"The form is invalid: {error}.") from None
    text = typed.get(QUESTION, "")
    try:
        found = await run_sync(answer, store, text)
    except (InputError, NotFound) as error:
        return page(TEMPLATE, RiskView(typed=text, problem=str(error)), HTTP_REFUSED)
    return page(TEMPLATE, make_risk_view(text, found))


def answer(store: Store, text: str) -> RiskAssessment:
    """Return the answer to a question as TOML.

    Raises:
        InvalidValue: the text is not TOML, or a field of it cannot be.
        NotFound: the campaign does not exist.
    """
    given = parse_toml(text, QUESTION, LIKE_RISK)
    return assess_campaigns(store, convert({"name": "Risk", **given}, RiskQuestion, QUESTION))


def make_risk_view(typed: str, found: RiskAssessment) -> RiskView:
    """Return the page of an answer."""
    allocation, *sentences = describe_allocation(found.next)
    return RiskView(
        typed=typed,
        verdict=describe_verdict(found),
        mark=MARKS[found.verdict],
        tables=tuple(list_tables(found)),
        allocation=allocation if isinstance(allocation, Table) else None,
        sentences=tuple(each for each in sentences if isinstance(each, str)),
        limits=tuple(list_limits(found)),
    )
