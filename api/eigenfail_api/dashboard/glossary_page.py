"""The address of the glossary: the words that stand beside the figures, on one page."""

from fastapi import APIRouter
from fastapi.responses import HTMLResponse

from eigenfail.glossary import GLOSSARY
from eigenfail_api.dashboard.rendering import page

router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)


@router.get("/glossary")
def show_glossary() -> HTMLResponse:
    """What each statistic is, with its unit."""
    return page("glossary.html", GLOSSARY)
