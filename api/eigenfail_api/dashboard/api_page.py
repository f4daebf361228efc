"""The address of the API's reference: made here, so that it can be read without a network."""

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse

from eigenfail_api.dashboard.rendering import page
from eigenfail_api.dashboard.views.reference import reference

router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)


@router.get("/api")
def show_api(request: Request) -> HTMLResponse:
    """All routes with their parameters, answers and an example; those that read can be tried."""
    address = str(request.base_url).rstrip("/")
    return page("api.html", reference(request.app.openapi(), address))
