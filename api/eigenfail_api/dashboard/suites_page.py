"""The addresses of suites: which there are, and each as one table."""

from fastapi import APIRouter
from fastapi.responses import HTMLResponse

from eigenfail_api.dashboard.rendering import page
from eigenfail_api.dashboard.views.suites import suite_view, suites_view
from eigenfail_api.parameters import Before, Stored
from eigenfail_services.campaigns.suites import suite_table

router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)

SUITES_ON_A_PAGE = 50


@router.get("/suites")
def show_suites(store: Stored, before: Before = None) -> HTMLResponse:
    """All suites, those with the newest campaigns first."""
    listed = store.campaigns.suites(SUITES_ON_A_PAGE, before)
    return page("suites.html", suites_view(listed, before))


@router.get("/suites/{suite:path}")
def show_suite(store: Stored, suite: str) -> HTMLResponse:
    """One suite."""
    return page("suite.html", suite_view(suite_table(store, suite)))
