"""The route of the REST API, and what the plug-in adds to the service."""

from collections.abc import Callable
from enum import StrEnum
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Query, Response

from eigenfail.wire.http import PREFIX
from eigenfail_api.concurrency import ConcurrencyLimit
from eigenfail_api.dashboard.rendering import CampaignFile
from eigenfail_api.extensions import Extension
from eigenfail_api.openapi import JSON, problem_response, schema
from eigenfail_api.parameters import LARGEST, Stored
from eigenfail_reports.contents import MOST_CAMPAIGNS, Report
from eigenfail_reports.report import Made, make
from eigenfail_services.store.clock import now_ms

router = APIRouter(prefix=PREFIX, tags=["analyses"])

REPORTS = Depends(ConcurrencyLimit("reports"), scope="function")
HTML, ZIP = "text/html; charset=utf-8", "application/zip"


class Form(StrEnum):
    """File format of a report."""

    HTML = "html"
    JSON = "json"
    ZIP = "zip"


WRITERS: dict[Form, tuple[str, Callable[[Made], bytes]]] = {
    Form.HTML: (HTML, Made.html),
    Form.JSON: (JSON, Made.json),
    Form.ZIP: (ZIP, Made.bundle),
}

CONTENT: dict[str, Any] = {
    JSON: schema(Report),
    HTML: {"schema": {"type": "string"}},
    ZIP: {"schema": {"type": "string", "format": "binary"}},
}

Campaigns = Annotated[
    list[Annotated[int, Query(ge=1, le=LARGEST)]],
    Query(min_length=1, max_length=MOST_CAMPAIGNS, description="Id of a campaign; repeatable."),
]
AsFormat = Annotated[
    Form,
    Query(alias="format", description="`zip`: the page, its data, tables and pictures."),
]


@router.get(
    "/report",
    response_class=Response,
    responses={200: {"content": CONTENT}, "default": problem_response()},
    dependencies=[REPORTS],
)
def get_report(store: Stored, campaign: Campaigns, format_: AsFormat = Form.HTML) -> Response:
    """Get a report on campaigns as a self-contained file."""
    kind, write = WRITERS[format_]
    # A download is no page of this service: the report brings its own policy for scripts.
    named = {"Content-Disposition": f'attachment; filename="report.{format_}"'}
    return Response(write(make(store, campaign, now_ms())), media_type=kind, headers=named)


ADDRESS = f"{PREFIX}/report?campaign={{campaign}}&format="

extension = Extension(
    routers=(router,),
    campaign_files=(
        CampaignFile("Report", "HTML", f"{ADDRESS}html", is_button=True),
        CampaignFile("Tables, figures and page", "ZIP", f"{ADDRESS}zip"),
        CampaignFile("Report data", "JSON", f"{ADDRESS}json"),
    ),
)
