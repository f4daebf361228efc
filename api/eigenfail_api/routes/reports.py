"""Reports on campaigns: a page, its data, or all of it as a bundle."""

from collections.abc import Callable
from enum import StrEnum
from typing import Annotated, Any

from fastapi import APIRouter, Query, Response

from eigenfail.values.report import MOST_CAMPAIGNS, Report
from eigenfail.wire.http import PREFIX
from eigenfail_api.parameters import LARGEST, Stored
from eigenfail_api.schemas import JSON, refusal, schema
from eigenfail_services.reports.report import Made, make
from eigenfail_services.store.clock import now_ms

router = APIRouter(prefix=f"{PREFIX}/report", tags=["campaigns"])

HTML, ZIP = "text/html; charset=utf-8", "application/zip"


class Form(StrEnum):
    """As what a report is given."""

    HTML = "html"
    JSON = "json"
    ZIP = "zip"


WRITERS: dict[Form, tuple[str, Callable[[Made], bytes]]] = {
    Form.HTML: (HTML, Made.html),
    Form.JSON: (JSON, Made.json),
    Form.ZIP: (ZIP, Made.bundle),
}
TEXT: dict[str, Any] = {"schema": {"type": "string"}}
CONTENT: dict[str, Any] = {
    JSON: schema(Report),
    HTML: TEXT,
    ZIP: {"schema": {"type": "string", "format": "binary"}},
}

Campaigns = Annotated[
    list[Annotated[int, Query(ge=1, le=LARGEST)]],
    Query(min_length=1, max_length=MOST_CAMPAIGNS, description="Id of a campaign; again for more."),
]
AsForm = Annotated[
    Form, Query(alias="format", description="`zip`: the page, its data, tables and pictures.")
]


@router.get(
    "", response_class=Response, responses={200: {"content": CONTENT}, "default": refusal()}
)
def get_report(store: Stored, campaign: Campaigns, form: AsForm = Form.HTML) -> Response:
    """What campaigns found so far, as a file that needs nothing else."""
    kind, write = WRITERS[form]
    # A file, not a page of this service: it has a policy of its own for scripts and styles.
    named = {"Content-Disposition": f'attachment; filename="report.{form}"'}
    return Response(write(make(store, campaign, now_ms())), media_type=kind, headers=named)
